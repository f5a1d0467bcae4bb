// Entry points of the native engine: signals, histories, misfits, residuals and their derivatives.

#include "call.h"

namespace sysid {
namespace {

// Integrates with the number of body coordinates known to the compiler; false if it is not compiled for it.
template <int NB = kFewest, class V, class M, class Sink>
bool simulate(const Inputs& in, const Run<M>& run, const Laws<V>& laws, Sink&& sink) {
  if constexpr (NB > kMost) {
    return false;
  } else if (in.coordinates != NB) {
    return simulate<NB + 1>(in, run, laws, sink);
  } else {
    if (in.filter.pole.empty())
      integrate<V, M, NB, false>(run, laws, in.channels, in.filter, in.clock, sink);
    else
      integrate<V, M, NB, true>(run, laws, in.channels, in.filter, in.clock, sink);
    return true;
  }
}

template <class Sink>
bool simulate_runs(const Inputs& in, const Lanes& lanes, Sink&& sink) {
  std::vector<std::vector<Pack>> numbers;
  return simulate(in, in.runs_of(lanes, numbers), in.laws(lanes), sink);
}

// Sets of one run. Over edges the road under a wheel depends on the set.
template <class Sink>
bool simulate_sets(const Inputs& in, const Lanes& lanes, Sink&& sink) {
  if (in.edged) return simulate_runs(in, lanes, sink);
  return simulate(in, in.run(lanes.run[0]), in.laws(lanes), sink);
}

template <class Sink>
bool simulate(const Inputs& in, const Lanes& lanes, Sink&& sink) {
  return in.sets > 1 ? simulate_sets(in, lanes, sink) : simulate_runs(in, lanes, sink);
}

// Signals (T, R, C, S).
Problem sensors(const Inputs& in, double* const* out) {
  const int64_t channels = in.channels.count();
  const std::vector<Lanes> packs = in.packs();
  std::atomic<bool> known{true};
  share(packs.size(), [&](int64_t task) {
    const Lanes& lanes = packs[task];
    known = simulate(in, lanes, [&](int64_t t, const auto&, const auto&, const Pack* shown) {
      double* at = out[kSensorsSignals] + t * in.runs * channels * in.sets;
      for (int64_t c = 0; c < channels; ++c) store(shown[c], at, channels, c, lanes, in.sets);
    });
  });
  return finish(known);
}

// Unfiltered histories in the order of the fields of Histories, (T, R, na | nr | nb, S); all axles are observed.
Problem histories(const Inputs& in, double* const* out) {
  const int64_t na = in.axles;
  const std::vector<Lanes> packs = in.packs();
  std::atomic<bool> known{true};
  share(packs.size(), [&](int64_t task) {
    const Lanes& lanes = packs[task];
    known = simulate(in, lanes, [&](int64_t t, const auto& now, const auto& state, const Pack* shown) {
      const auto put = [&](int field, int64_t width, int64_t k, const Pack& x) {
        store(x, out[field] + t * in.runs * width * in.sets, width, k, lanes, in.sets);
      };
      for (int64_t i = 0; i < na; ++i) {
        put(kHistoriesDeflection, na, i, shown[i]);
        put(kHistoriesAxleAcceleration, na, i, shown[na + i]);
        put(kHistoriesTireForce, na, i, positive(now.unclipped[i]));
        put(kHistoriesHorizontalForce, na, i, now.horizontal[i]);
        put(kHistoriesSuspensionForce, na, i, -now.pull[i]);
      }
      for (int64_t k = 0; k < in.body_sensors; ++k)
        put(kHistoriesBodyAcceleration, in.body_sensors, k, shown[2 * na + k]);
      for (int64_t k = 0; k < in.coordinates; ++k) put(kHistoriesBody, in.coordinates, k, state.body[k]);
    });
  });
  return finish(known);
}

// Squares (R, S) and products with columns (R, K, S) of one run and some packs of sets; their signals never leave the
// cache.
template <int kPacks>
bool misfits_of(const Inputs& in, const Measured& measured, const Lanes* lanes, double* const* out) {
  const int64_t channels = in.channels.count(), r = lanes->run[0];
  const Columns& columns = measured.columns[r];
  const std::unique_ptr<Pack[]> signals(new Pack[kPacks * in.clock.samples * channels]);  // (C, T) of each
  std::vector<Pack> products(kPacks * columns.count);
  Pack squares[kPacks], *signal[kPacks], *product[kPacks];
  bool known = true;
  for (int p = 0; p < kPacks; ++p) {
    signal[p] = &signals[p * in.clock.samples * channels];
    product[p] = products.data() + p * columns.count;
    known &= simulate_sets(in, lanes[p], [&](int64_t t, const auto&, const auto&, const Pack* shown) {
      for (int64_t c = 0; c < channels; ++c) signal[p][c * in.clock.samples + t] = shown[c];
    });
  }
  misfit<kPacks>(measured.readings[r], columns, signal, static_cast<int>(channels), squares, product);
  for (int p = 0; p < kPacks; ++p) {
    store(squares[p], out[kMisfitsSquares], 1, 0, lanes[p], in.sets);
    for (int k = 0; k < columns.count; ++k) store(product[p][k], out[kMisfitsProducts], columns.count, k, lanes[p], in.sets);
  }
  return known;
}

// Squares (R, S) of every run and set, and products with columns (R, K, S).
Problem misfits(const Inputs& in, double* const* out) {
  // Packs of one run stand next to each other: two of them go through the columns together.
  constexpr int64_t together = 2;
  const std::vector<Lanes> packs = in.packs_of_sets();
  const int64_t of_run = (in.sets + kLanes - 1) / kLanes, tasks = (of_run + together - 1) / together;
  const Measured measured(in, kMisfitsReadings, kMisfitsColumns);
  std::atomic<bool> known{true};
  share(in.runs * tasks, [&](int64_t task) {
    const int64_t first = task % tasks * together;
    const Lanes* lanes = &packs[task / tasks * of_run + first];
    const bool found =
        first + together <= of_run ? misfits_of<together>(in, measured, lanes, out) : misfits_of<1>(in, measured, lanes, out);
    if (!found) known = false;
  });
  return finish(known);
}

// One block of derivatives of one run: signals, residuals (T, R, C[, P]) and gain residuals (R, C[, P]).
template <int T>
bool linearise_block(const Inputs& in, int64_t r, int64_t first, double* const* out) {
  const int64_t channels = in.channels.count(), samples = in.clock.samples;
  const int64_t unknowns = in.shape(kLineariseTangents + kLawTangents)[3];
  const int64_t last = std::min<int64_t>(unknowns, first + T * kLanes - 1);
  const std::unique_ptr<Jet<T>[]> signal(new Jet<T>[samples * channels]);  // (C, T)
  const bool known =
      simulate(in, in.run(r), in.jets<T>(r, first), [&](int64_t t, const auto&, const auto&, const Jet<T>* shown) {
        for (int64_t c = 0; c < channels; ++c) signal[c * samples + t] = shown[c];
      });
  const Readings data = in.readings(r, kLineariseReadings);
  const auto put = [&](const Jet<T>& x, int64_t at, double* values, double* derivatives) {
    if (first == 0) values[at] = value(x);
    const double* lane = reinterpret_cast<const double*>(x.d) + 1;
    for (int64_t k = first; k < last; ++k) derivatives[at * unknowns + k] = lane[k - first];
  };
  std::vector<SensorFit<Jet<T>>> fit;
  for (int c = 0; c < channels; ++c) {
    fit.push_back(fit_sensor(data, &signal[c * samples], c));
    put(fit[c].gain_residual, r * channels + c, out[kLineariseGainResidual], out[kLineariseGainJacobian]);
  }
  for (int64_t t = 0; t < samples; ++t)
    for (int c = 0; c < channels; ++c) {
      const int64_t at = (t * in.runs + r) * channels + c;
      const Jet<T>& y = signal[c * samples + t];
      put(residual(data, fit[c], y, t, c), at, out[kLineariseResidual], out[kLineariseResidualJacobian]);
      if (first == 0) out[kLineariseSimulated][at] = value(y);
    }
  return known;
}

// Residuals, their derivatives, gain residuals, their derivatives, signals.
Problem linearise(const Inputs& in, double* const* out) {
  constexpr int narrow = 16 / kLanes, wide = 32 / kLanes;
  const int64_t unknowns = in.shape(kLineariseTangents + kLawTangents)[3], block = wide * kLanes - 1;
  const int64_t blocks = (unknowns + block - 1) / block;
  std::atomic<bool> known{true};
  share(in.runs * blocks, [&](int64_t task) {
    const int64_t r = task / blocks, first = task % blocks * block;
    if (unknowns - first < narrow * kLanes)
      known = linearise_block<narrow>(in, r, first, out);
    else
      known = linearise_block<wide>(in, r, first, out);
  });
  return finish(known);
}

}  // namespace
}  // namespace sysid

SYSID_ENTRY(sensors, kSensorsCount)
SYSID_ENTRY(histories, kHistoriesCount)
SYSID_ENTRY(misfits, kMisfitsCount)
SYSID_ENTRY(linearise, kLineariseCount)
