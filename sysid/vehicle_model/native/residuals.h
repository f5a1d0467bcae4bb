// Residuals of one run: the equations of eliminate_sensors, standardised_residuals and _misfits in Python.

#pragma once

#include <algorithm>
#include <type_traits>
#include <vector>

#include "integration.h"

namespace sysid {

// Rows (T, C) of one run, `stride` apart, as (C, T): what follows goes through the samples of channel after channel.
inline std::vector<double> by_channel(const double* rows, int64_t samples, int64_t stride, int64_t channels) {
  std::vector<double> all(channels * samples);
  for (int64_t t = 0; t < samples; ++t)
    for (int64_t c = 0; c < channels; ++c) all[c * samples + t] = rows[t * stride + c];
  return all;
}

// Readings (C, T) and weights (C,) of one run. `measured` holds the square roots of the weights of plain readings, 0
// where there is none.
struct Readings {
  std::vector<double> value, measured, censored, noise_sd, tempering, gain_sd;
  int64_t samples;
};

template <class V>
struct SensorFit {
  V offset, gain, gain_residual;
  double scale;
};

// x where it lies beyond zero on the side opposite to `side`, else 0.
inline Pack beyond(const Pack& x, double side) {
  return select(side * x < 0.0, x, Pack{});
}
template <int T>
inline Jet<T> beyond(const Jet<T>& x, double side) {
  return side * value(x) < 0.0 ? x : Jet<T>{};
}

// Offset and gain of channel c that minimise its weighted squares plus the gain's prior:
//   gain = (S_yd / sigma^2 + 1 / s_g^2) / (S_yy / sigma^2 + 1 / s_g^2),   offset = mean(d) - gain mean(y).
// `signal` holds its signal (samples,).
template <class V>
SensorFit<V> fit_sensor(const Readings& data, const V* signal, int c) {
  double count = 0.0, sum_d = 0.0;
  V sum_y{};
  const double *value = &data.value[c * data.samples], *roots = &data.measured[c * data.samples];
  for (int64_t t = 0; t < data.samples; ++t) {
    const double root = roots[t], share = root * root;
    count += share;
    sum_d += share * value[t];
    sum_y += share * signal[t];
  }
  if (!(count > 0.0)) count = 1.0;
  const V mean_y = (1.0 / count) * sum_y;
  V s_yy{}, s_yd{};
  for (int64_t t = 0; t < data.samples; ++t) {
    const double root = roots[t];
    const V centred = root * (signal[t] - mean_y);
    s_yy += centred * centred;
    s_yd += root * value[t] * centred;
  }
  const double sigma = data.noise_sd[c] / data.tempering[c], spread = data.gain_sd[c];
  const double weight = 1.0 / (sigma * sigma), prior = 1.0 / (spread * spread);
  SensorFit<V> fit;
  fit.gain = (prior + weight * s_yd) / (prior + weight * s_yy);
  fit.offset = sum_d / count + -(fit.gain * mean_y);
  fit.gain_residual = select(finite(data.noise_sd[c]), (1.0 / spread) * (-1.0 + fit.gain), V{});
  fit.scale = data.tempering[c] / data.noise_sd[c];
  return fit;
}

// (offset + gain y - d) / sigma; a clipped sample counts only where the simulation stays inside the range.
template <class V>
inline V residual(const Readings& data, const SensorFit<V>& fit, const V& y, int64_t t, int c) {
  const int64_t at = c * data.samples + t;
  const V difference = -data.value[at] + (fit.offset + fit.gain * y);
  V counted = data.measured[at] * difference;
  const double censored = data.censored[at];
  if (censored != 0.0) counted += absolute(censored) * beyond(difference, censored);
  return fit.scale * counted;
}

// Columns of one run, (n, C, T) where they are, and (C, n).
struct Columns {
  const double* along;
  std::vector<double> gain;
  int count;
};

// r'r and the products A'r of the residuals of a run with n columns, for each of some packs of sets: `squares` has a
// number for each, `products` n; their signals (C, T) are overwritten.
template <int kPacks>
inline void misfit(const Readings& data, const Columns& columns, Pack* const* signals, int channels, Pack* squares,
                   Pack* const* products) {
  constexpr int kTogether = 4;
  const int n = columns.count;
  const int64_t samples = data.samples;
  for (int p = 0; p < kPacks; ++p) {
    squares[p] = Pack{};
    std::fill(products[p], products[p] + n, Pack{});
  }
  for (int c = 0; c < channels; ++c) {
    Pack* shown[kPacks];
    for (int p = 0; p < kPacks; ++p) {
      shown[p] = signals[p] + c * samples;
      const SensorFit<Pack> fit = fit_sensor(data, shown[p], c);
      const Pack g = fit.gain_residual;
      squares[p] += g * g;
      for (int k = 0; k < n; ++k) products[p][k] += columns.gain[n * c + k] * g;
      for (int64_t t = 0; t < samples; ++t) {
        const Pack r = residual(data, fit, shown[p][t], t, c);
        shown[p][t] = r;
        squares[p] += r * r;
      }
    }
    // The residuals of a channel stay in a near cache, the columns do not: some of each at a time.
    const auto summed = [&](int first, auto together) {
      constexpr int count = together;
      const double* of[count];
      for (int j = 0; j < count; ++j) of[j] = columns.along + ((first + j) * channels + c) * samples;
      Pack sums[kPacks][count] = {};
      for (int64_t t = 0; t < samples; ++t)
        for (int p = 0; p < kPacks; ++p)
          for (int j = 0; j < count; ++j) sums[p][j] += of[j][t] * shown[p][t];
      for (int p = 0; p < kPacks; ++p)
        for (int j = 0; j < count; ++j) products[p][first + j] += sums[p][j];
    };
    int k = 0;
    for (; k + kTogether <= n; k += kTogether) summed(k, std::integral_constant<int, kTogether>{});
    for (; k < n; ++k) summed(k, std::integral_constant<int, 1>{});
  }
}

}  // namespace sysid
