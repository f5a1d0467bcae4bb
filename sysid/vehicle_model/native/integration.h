// One run of the planar vehicle over a bump, from step to step, and what its sensors show (equations of simulation.py and
// filters.py).

#pragma once

#include <utility>

#include "vehicle.h"

namespace sysid {

// ------------------------------------------------------------------------------------------------- sensors and filter

// Signals in the order of the channels: deflections, axle accelerations, body accelerations, pitch rates.
struct Channels {
  std::vector<int> deflection, acceleration;
  int body, rate;
  int count() const { return static_cast<int>(deflection.size() + acceleration.size()) + body + rate; }
};

template <int NB, class V, class M>
void observe(const Run<M>& run, const Channels& channels, const V* extension, const V* axle, const V* body,
             const V* body_rate, V* signal) {
  V above[kMaxAxles], wheel[kMaxAxles];
  if (run.beams.wheel != nullptr) {
    transform(run.beams.wheel, run.axles, extension, above);
    transform(run.beams.wheel, run.axles, axle, wheel);
    extension = above;
    axle = wheel;
  }
  for (const int i : channels.deflection) *signal++ = extension[i];
  for (const int i : channels.acceleration) *signal++ = axle[i];
  for (int k = 0; k < channels.body; ++k) {
    const M* row = run.body_rows + k * NB;
    V sum{};
    for (int j = 0; j < NB; ++j) accumulate(sum, row[j], body[j]);
    *signal++ = sum;
  }
  for (int k = 0; k < channels.rate; ++k) {
    const M* row = run.rate_rows + k * NB;
    V sum{};
    for (int j = 0; j < NB; ++j) accumulate(sum, row[j], body_rate[j]);
    *signal++ = sum;
  }
}

// One pole of the anti-alias filter: x' = decay x + start u_n + middle u_(n+1/2), shown = direct u_n + Re(sum w x).
struct Pole {
  double decay[2], start[2], middle[2], weight[2];
};

struct Filter {
  std::vector<Pole> pole;
  double direct;
};

template <class V>
class FilterMemory {
 public:
  FilterMemory(const Filter& filter, int channels)
      : filter_(filter), channels_(channels), real_(filter.pole.size() * channels), imaginary_(real_.size()) {}

  void show(const V* now, V* shown) const {
    for (int c = 0; c < channels_; ++c) {
      V sum = filter_.direct * now[c];
      for (size_t k = 0; k < filter_.pole.size(); ++k) {
        const double* w = filter_.pole[k].weight;
        sum += w[0] * real_[k * channels_ + c] - w[1] * imaginary_[k * channels_ + c];
      }
      shown[c] = sum;
    }
  }

  void advance(const V* now, const V* middle) {
    for (size_t k = 0; k < filter_.pole.size(); ++k) {
      const Pole& p = filter_.pole[k];
      V *re = &real_[k * channels_], *im = &imaginary_[k * channels_];
      for (int c = 0; c < channels_; ++c) {
        const V x = re[c], y = im[c];
        re[c] = p.decay[0] * x - p.decay[1] * y + p.start[0] * now[c] + p.middle[0] * middle[c];
        im[c] = p.decay[1] * x + p.decay[0] * y + p.start[1] * now[c] + p.middle[1] * middle[c];
      }
    }
  }

 private:
  const Filter& filter_;
  int channels_;
  std::vector<V> real_, imaginary_;
};

// -------------------------------------------------------------------------------------------------------- integration

struct Clock {
  int64_t samples, substeps;
  double interval;
  double step() const { return interval / static_cast<double>(substeps); }
  int64_t steps() const { return (samples - 1) * substeps + 1; }
};

// y = x + a u, and y = x + a u + b v, for n numbers.
template <class V>
inline void plus(int n, const V* x, double a, const V* u, V* y) {
  for (int k = 0; k < n; ++k) y[k] = x[k] + a * u[k];
}
template <class V>
inline void plus(int n, const V* x, double a, const V* u, double b, const V* v, V* y) {
  for (int k = 0; k < n; ++k) y[k] = x[k] + a * u[k] + b * v[k];
}
// n places x and rates v after a step h, from the accelerations at its stages.
template <class V>
inline void advance(int n, double h, const V* a1, const V* a2, const V* a3, const V* a4, V* x, V* v) {
  for (int k = 0; k < n; ++k) {
    const V between = a2[k] + a3[k];
    x[k] += h * v[k] + h * h / 6.0 * (a1[k] + between);
    v[k] += h / 6.0 * (a1[k] + 2.0 * between + a4[k]);
  }
}

// One step of the time integration from the state `at`, without the road and the filter of the sensors.
//
// The step is the classical fourth-order Runge-Kutta scheme in its second-order (Nystrom) form with the exact integral
// of forces at their corners.
template <class V, class M, int NB>
class Step {
 public:
  Step(const Run<M>& run, const Laws<V>& laws, const Channels& channels, double h)
      : run_(run), laws_(laws), channels_(channels), h_(h), half_(0.5 * h), wheels_(run), stage_(4), trial_(1),
        bushing_(run.elements.damper_bushing ? run.axles : 0) {}

  // The first stage: forces at the start, where wheels rest in the lanes `resting`.
  void begin(const PointFor<M>* road, double time, const State<V, NB>& at, const Where<M>& resting) {
    forces<V, M, NB>(run_, laws_, road, wheels_, time, at, at.inner, nullptr, stage_[0]);
    hold(resting, stage_[0]);
  }

  // The other stages; `at` becomes the state at the end.
  void finish(const PointFor<M>* middle, const PointFor<M>* end, double time, State<V, NB>& at,
              const Where<M>& resting) {
    const int na = run_.axles;
    const double h = h_, half = half_;
    Forces<V, NB>&first = stage_[0], &second = stage_[1], &third = stage_[2], &fourth = stage_[3];
    State<V, NB>& trial = trial_[0];
    const StageOfStep<V> at_middle{half, false, bushing_.data(), first.extension, first.rate, nullptr, nullptr},
        at_end{h, true, bushing_.data(), first.extension, first.rate, second.rate, third.rate};
    if (run_.elements.damper_bushing)
      for (int i = 0; i < na; ++i)
        begin_bushing(run_.elements, laws_.suspension[i], at.inner.damper_rate[i], half, h, bushing_[i]);
    plus(NB, at.body, half, at.body_rate, trial.body);
    plus(NB, at.body_rate, half, first.body, trial.body_rate);
    plus(na, at.axle, half, at.axle_rate, trial.axle);
    plus(na, at.axle_rate, half, first.axle, trial.axle_rate);
    forces<V, M, NB>(run_, laws_, middle, wheels_, time + half, trial, at.inner, &at_middle, second);
    hold(resting, second);
    plus(NB, at.body, half, at.body_rate, half * half, first.body, trial.body);
    plus(NB, at.body_rate, half, second.body, trial.body_rate);
    plus(na, at.axle, half, at.axle_rate, half * half, first.axle, trial.axle);
    plus(na, at.axle_rate, half, second.axle, trial.axle_rate);
    forces<V, M, NB>(run_, laws_, middle, wheels_, time + half, trial, at.inner, &at_middle, third);
    hold(resting, third);
    plus(NB, at.body, h, at.body_rate, h * half, second.body, trial.body);
    plus(NB, at.body_rate, h, third.body, trial.body_rate);
    plus(na, at.axle, h, at.axle_rate, h * half, second.axle, trial.axle);
    plus(na, at.axle_rate, h, third.axle, trial.axle_rate);
    forces<V, M, NB>(run_, laws_, end, wheels_, time + h, trial, at.inner, &at_end, fourth);
    hold(resting, fourth);

    advance(NB, h, first.body, second.body, third.body, fourth.body, at.body, at.body_rate);
    advance(na, h, first.axle, second.axle, third.axle, fourth.axle, at.axle, at.axle_rate);
    find_missed(run_, laws_, stage_, missed_);
    if (missed_.at_axles) {
      for (int i = 0; i < na; ++i) {
        at.axle[i] += h * h * missed_.axle_moment[i];
        at.axle_rate[i] += h * missed_.axle[i];
      }
    }
    if (missed_.at_bodies) {
      for (int j = 0; j < NB; ++j) {
        at.body[j] += h * h * missed_.body_moment[j];
        at.body_rate[j] += h * missed_.body[j];
      }
    }
    if (!run_.elements.friction && !run_.elements.damper_bushing) return;
    V extension[kMaxAxles], rate[kMaxAxles];
    above_axles<NB>(run_.position, na, at.body, at.axle, extension);
    above_axles<NB>(run_.position, na, at.body_rate, at.axle_rate, rate);
    if (run_.elements.friction)
      for (int i = 0; i < na; ++i)
        at.inner.slip[i] = slip_after_step(run_.elements, laws_.suspension[i], at.inner.slip[i], first.extension[i],
                                           first.rate[i], extension[i], rate[i], h);
    if (!run_.elements.damper_bushing) return;
    V followed[kMaxAxles];
    follow(run_.elements, na, laws_.suspension, bushing_.data(), true, at.inner.damper_rate, first.rate, h, followed,
           [&](int i, V& linear, V& bend) {
             // The rate's parabola through both ends whose mean is that of the step.
             bend = 3.0 * (first.rate[i] + rate[i]) - (6.0 / h) * (extension[i] - first.extension[i]);
             linear = rate[i] - first.rate[i] - bend;
           });
    for (int i = 0; i < na; ++i) at.inner.damper_rate[i] = followed[i];
  }

  // Forces at the start, known after `begin`.
  const Forces<V, NB>& start() const { return stage_[0]; }

  // What the sensors feel at the start.
  void observe_start(V* signal) const {
    observe<NB>(run_, channels_, stage_[0].extension, stage_[0].axle, stage_[0].body, stage_[0].body_rate, signal);
  }

  // What they feel in the middle, for the filter, known after `finish`. At a corner the filter's quadratic through start,
  // middle and end has the exact impulse of the force.
  void observe_middle(V* signal) {
    const Forces<V, NB>&second = stage_[1], &third = stage_[2];
    State<V, NB>& middle = trial_[0];
    for (int i = 0; i < run_.axles; ++i) {
      middle.axle[i] = 0.5 * (second.extension[i] + third.extension[i]);
      middle.axle_rate[i] = 0.5 * (second.axle[i] + third.axle[i]);
      if (missed_.at_axles) middle.axle_rate[i] += 1.5 * missed_.axle[i];
    }
    for (int j = 0; j < NB; ++j) {
      middle.body[j] = 0.5 * (second.body[j] + third.body[j]);
      if (missed_.at_bodies) middle.body[j] += 1.5 * missed_.body[j];
      if (channels_.rate > 0) middle.body_rate[j] = 0.5 * (second.body_rate[j] + third.body_rate[j]);
    }
    observe<NB>(run_, channels_, middle.axle, middle.axle_rate, middle.body, middle.body_rate, signal);
  }

 private:
  // Forces cancel up to rounding before a wheel meets the bump: what is at rest stays at rest.
  void hold(const Where<M>& resting, Forces<V, NB>& of) const {
    if (!any(resting)) return;
    for (int j = 0; j < NB; ++j) clear(resting, of.body[j]);
    for (int i = 0; i < run_.axles; ++i) clear(resting, of.axle[i]), clear(resting, of.pull[i]);
  }

  const Run<M>& run_;
  const Laws<V>& laws_;
  const Channels& channels_;
  double h_, half_;
  RoadUnderWheels<M> wheels_;  // at its stages
  std::vector<Forces<V, NB>> stage_;
  std::vector<State<V, NB>> trial_;
  std::vector<BushingStart<V>> bushing_;
  Missed<V, NB> missed_;
};

// Integrates one run, or one in each lane, and calls sink(sample, forces, state, shown) at every sample.  The start is the
// static equilibrium, so nothing moves before a wheel reaches the bump.
template <class V, class M, int NB, bool Filtered, class Sink>
void integrate(const Run<M>& run, const Laws<V>& laws, const Channels& channels, const Filter& filter, const Clock& clock,
               Sink&& sink) {
  const int na = run.axles, nc = channels.count();
  const double h = clock.step();
  RoadUnderWheels<M> wheels(run);
  std::vector<PointFor<M>> points(3 * na);
  PointFor<M>*road = &points[0], *road_middle = &points[na], *road_end = &points[2 * na];
  FilterMemory<V> memory(filter, nc);
  std::vector<V> now(nc), middle(nc), shown(nc);
  std::vector<State<V, NB>> states(1);
  State<V, NB>& at = states[0];
  Step<V, M, NB> step_of(run, laws, channels, h);

  Where<M> resting = opposite(wheels.look_up(0.0, road));
  const int64_t steps = clock.steps();
  for (int64_t step = 0; step < steps; ++step) {
    const double time = static_cast<double>(step) * h;
    const bool sampled = step % clock.substeps == 0;
    if (step > 0) std::swap(road, road_end);
    const Where<M> middle_felt = wheels.look_up(static_cast<double>(2 * step + 1) * (0.5 * h), road_middle),
                   end_felt = wheels.look_up(static_cast<double>(2 * step + 2) * (0.5 * h), road_end);
    resting = resting & opposite(middle_felt | end_felt);
    const bool all_rest = !any(opposite(resting));
    if (!all_rest || step == 0) step_of.begin(road, time, at, resting);
    if (Filtered || sampled) step_of.observe_start(now.data());
    if (sampled) {
      if (Filtered) memory.show(now.data(), shown.data());
      sink(step / clock.substeps, step_of.start(), at, Filtered ? shown.data() : now.data());
    }
    if (all_rest || step + 1 == steps) continue;
    step_of.finish(road_middle, road_end, time, at, resting);
    if (!Filtered) continue;
    step_of.observe_middle(middle.data());
    memory.advance(now.data(), middle.data());
  }
}

}  // namespace sysid
