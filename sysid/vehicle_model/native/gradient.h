// Derivatives of a run's misfit by all rows of its laws: the run backwards, step after step, each recorded on a tape.

#pragma once

#include <utility>

#include "residuals.h"
#include "taped_laws.h"

namespace sysid {

// Slopes (samples,) of the misfit by the signal of channel c, with `pull` as `misfit` gives it.
//
// By a residual the misfit has the slope 2 (r - J pull); offset and gain are functions of the signal (`fit_sensor`).
template <class M>
void slopes_by_signal(const Readings<M>& data, const LocalColumns<M>& local, const Pack* signal, int c, int channels,
                      const Pack (&pull)[kMotionNumbers], Pack* slopes) {
  constexpr int n = kMotionNumbers;
  const SensorFit<Pack, M> fit = fit_sensor(data, signal, c);
  const int64_t samples = data.samples;
  const M *value = &data.value[c * samples], *roots = &data.measured[c * samples],
          *censored = &data.censored[c * samples];
  const M* column[n];
  Pack by_prior = fit.gain_residual;
  for (int k = 0; k < n; ++k) {
    column[k] = &local.along[(k * channels + c) * samples];
    by_prior -= local.gain[n * c + k] * pull[k];
  }
  Pack by_gain = (2.0 / data.gain_sd[c]) * by_prior, by_offset{};
  for (int64_t t = 0; t < samples; ++t) {
    const Pack difference = -value[t] + (fit.offset + fit.gain * signal[t]);
    Pack weight = roots[t] - Pack{};
    if (any(censored[t] != 0.0))
      weight += select(censored[t] * difference < 0.0, absolute(censored[t]) - Pack{}, Pack{});
    Pack by_residual = residual(data, fit, signal[t], t, c);
    for (int k = 0; k < n; ++k) by_residual -= column[k][t] * pull[k];
    const Pack by_difference = 2.0 * fit.scale * weight * by_residual;
    by_offset += by_difference;
    by_gain += by_difference * signal[t];
    slopes[t] = fit.gain * by_difference;
  }
  // offset = mean(d) - gain mean(y),   gain = (prior + weight S_yd) / (prior + weight S_yy)
  by_gain -= by_offset * fit.mean;
  const Pack by_product = by_gain * fit.weight / fit.denominator, by_square = -2.0 * fit.gain * by_product;
  Pack by_mean = -fit.gain * by_offset;
  for (int64_t t = 0; t < samples; ++t) {
    const Pack by_centred = roots[t] * roots[t] * (value[t] * by_product + (signal[t] - fit.mean) * by_square);
    slopes[t] += by_centred;
    by_mean -= by_centred;
  }
  by_mean = by_mean / fit.count;
  for (int64_t t = 0; t < samples; ++t) slopes[t] += roots[t] * roots[t] * by_mean;
}

// Of each lane at the start of a step: what `integrate` lets others keep.
template <int NB>
struct KeptStates {
  std::vector<Pack> numbers;  // of step after step: body, body_rate, axle, axle_rate, slip
  std::vector<Mask> resting;
  int64_t first = -1;  // the first step that is kept; all that follow are

  KeptStates(int64_t steps, int axles) {
    numbers.reserve(steps * width(axles));
    resting.reserve(steps);
  }

  template <class Where>
  void keep(int64_t step, const State<Pack, NB>& state, const Where& where, int axles) {
    if (first < 0) first = step;
    resting.push_back(mask(where));
    each(state, axles, [&](const Pack& x) { numbers.push_back(x); });
  }

  // Calls `with` on every number of a state, in the order of `numbers`.
  template <class S, class With>
  static void each(S& state, int axles, With&& with) {
    for (int j = 0; j < NB; ++j) with(state.body[j]), with(state.body_rate[j]);
    for (int i = 0; i < axles; ++i) with(state.axle[i]), with(state.axle_rate[i]), with(state.slip[i]);
  }
  static int64_t width(int axles) { return 2 * NB + 3 * axles; }

 private:
  static Mask mask(const Mask& x) { return x; }
  static Mask mask(bool x) { return x ? ~Mask{} : Mask{}; }
};
// Where something holds in all lanes, or as a run whose sets fill the lanes sees it.
inline bool lanes_where(const Mask& x, const bool&) { return x[0] != 0; }
inline Mask lanes_where(const Mask& x, const Mask&) { return x; }

// Slopes of what follows by the memory of the filter, and how they go back through a step (see FilterMemory).
class FilterSlopes {
 public:
  FilterSlopes(const Filter& filter, int channels)
      : filter_(filter), channels_(channels), real_(filter.pole.size() * channels), imaginary_(real_.size()) {}

  // By what was felt at the start and in the middle of a step, which are added to.
  void advance(Pack* now, Pack* middle) {
    for (size_t k = 0; k < filter_.pole.size(); ++k) {
      const Pole& p = filter_.pole[k];
      Pack *re = &real_[k * channels_], *im = &imaginary_[k * channels_];
      for (int c = 0; c < channels_; ++c) {
        const Pack x = re[c], y = im[c];
        now[c] += p.start[0] * x + p.start[1] * y;
        middle[c] += p.middle[0] * x + p.middle[1] * y;
        re[c] = p.decay[0] * x + p.decay[1] * y;
        im[c] = p.decay[0] * y - p.decay[1] * x;
      }
    }
  }

  // From the slopes by what is shown.
  void show(const Pack* shown, Pack* now) {
    for (int c = 0; c < channels_; ++c) {
      now[c] += filter_.direct * shown[c];
      for (size_t k = 0; k < filter_.pole.size(); ++k) {
        const double* w = filter_.pole[k].weight;
        real_[k * channels_ + c] += w[0] * shown[c];
        imaginary_[k * channels_ + c] -= w[1] * shown[c];
      }
    }
  }

 private:
  const Filter& filter_;
  int channels_;
  std::vector<Pack> real_, imaginary_;
};

// Follows a run back from the slopes (C, T) of a result by its signals. Slopes by the numbers on the tape that the laws
// are made from are complete then.
template <class M, int NB, bool Filtered>
void follow_back(const Run<M>& run, const Laws<Taped>& laws, Tape& tape, const Channels& channels, const Filter& filter,
                 const Clock& clock, const KeptStates<NB>& kept, const Pack* by_signals) {
  const int na = run.axles, nc = channels.count();
  const int64_t width = kept.width(na);
  RoadOfSteps<M> wheels(run, clock);
  std::vector<PointFor<M>> points(3 * na);
  PointFor<M>*road = &points[0], *road_middle = &points[na], *road_end = &points[2 * na];
  FilterSlopes memory(filter, nc);
  std::vector<Pack> by_state(width), by_now(nc), by_middle(nc), by_shown(nc);
  std::vector<Taped> now(nc), middle(nc);
  std::vector<State<Taped, NB>> states(1);
  State<Taped, NB>& at = states[0];
  Step<Taped, M, NB> step_of(run, laws, channels, clock.step());
  const Tape::Mark mark = tape.mark();

  const int64_t last = clock.steps() - 1;
  wheels.look_up(2 * last + 2, road_end);
  for (int64_t step = last; step >= kept.first && kept.first >= 0; --step) {
    const double time = static_cast<double>(step) * clock.step();
    wheels.look_up(2 * step + 1, road_middle);
    wheels.look_up(2 * step, road);
    const int64_t number = step - kept.first;
    const Where<M> resting = lanes_where(kept.resting[number], Where<M>{});
    // The step once more, on the tape.
    const int32_t begin = tape.mark().places;
    const Pack* value_of = &kept.numbers[number * width];
    kept.each(at, na, [&](Taped& x) { x = tape.number(*value_of++); });
    step_of.begin(road, time, at, resting);
    const bool sampled = step % clock.substeps == 0;
    for (int c = 0; c < nc; ++c) by_now[c] = by_middle[c] = Pack{};
    if (step < last && Filtered) memory.advance(by_now.data(), by_middle.data());
    if (sampled) {
      for (int c = 0; c < nc; ++c) by_shown[c] = by_signals[c * clock.samples + step / clock.substeps];
      if (Filtered)
        memory.show(by_shown.data(), by_now.data());
      else
        by_now = by_shown;
    }
    const auto seed = [&](const Taped& x, const Pack& slope) {
      if (x.tape != nullptr) tape.slope(x.at) += slope;
    };
    if (Filtered || sampled) step_of.observe_start(now.data());
    if (step < last) {
      step_of.finish(road_middle, road_end, time, at, resting);
      const Pack* by = by_state.data();
      kept.each(at, na, [&](const Taped& x) { seed(x, *by++); });
      if (Filtered) {
        step_of.observe_middle(middle.data());
        for (int c = 0; c < nc; ++c) seed(middle[c], by_middle[c]);
      }
    }
    if (Filtered || sampled)
      for (int c = 0; c < nc; ++c) seed(now[c], by_now[c]);
    tape.back(mark);
    for (int k = 0; k < width; ++k) by_state[k] = tape.slope(begin + k);
    std::swap(road, road_end);
  }
  tape.back_to_start();
}

}  // namespace sysid
