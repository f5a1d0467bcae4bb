// Residuals of one run: the equations of eliminate_sensors, standardised_residuals and _misfits in Python.

#pragma once

#include <algorithm>
#include <vector>

#include "integration.h"

namespace sysid {

// Rows (T, C, n) of one run, `stride` apart, as (n, C, T): what follows goes through the samples of channel after channel.
inline std::vector<double> by_channel(const double* rows, int64_t samples, int64_t stride, int64_t channels, int n = 1) {
  std::vector<double> all(n * channels * samples);
  for (int64_t t = 0; t < samples; ++t)
    for (int64_t c = 0; c < channels; ++c)
      for (int k = 0; k < n; ++k) all[(k * channels + c) * samples + t] = rows[t * stride + c * n + k];
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

// Columns of one run, (n, C, T) and (C, n).
struct Columns {
  std::vector<double> along, gain;
  int count;
};

// r'r and the products A'r of the residuals of a run with n columns, (n,); signals (C, T) are overwritten.
inline Pack misfit(const Readings& data, const Columns& columns, Pack* signals, int channels, Pack* products) {
  constexpr int kTogether = 4;
  const int n = columns.count;
  Pack squares{};
  std::fill(products, products + n, Pack{});
  for (int c = 0; c < channels; ++c) {
    Pack* shown = signals + c * data.samples;
    const SensorFit<Pack> fit = fit_sensor(data, shown, c);
    const Pack g = fit.gain_residual;
    squares += g * g;
    for (int k = 0; k < n; ++k) products[k] += columns.gain[n * c + k] * g;
    for (int64_t t = 0; t < data.samples; ++t) {
      const Pack r = residual(data, fit, shown[t], t, c);
      shown[t] = r;
      squares += r * r;
    }
    const auto column = [&](int k) { return &columns.along[(k * channels + c) * data.samples]; };
    int k = 0;
    // The residuals of a channel stay in the nearest cache, the columns do not: some columns at a time.
    for (; k + kTogether <= n; k += kTogether) {
      const double* of[kTogether];
      Pack sums[kTogether] = {};
      for (int j = 0; j < kTogether; ++j) of[j] = column(k + j);
      for (int64_t t = 0; t < data.samples; ++t)
        for (int j = 0; j < kTogether; ++j) sums[j] += of[j][t] * shown[t];
      for (int j = 0; j < kTogether; ++j) products[k + j] += sums[j];
    }
    for (; k < n; ++k) {
      const double* of = column(k);
      Pack sum{};
      for (int64_t t = 0; t < data.samples; ++t) sum += of[t] * shown[t];
      products[k] += sum;
    }
  }
  return squares;
}

}  // namespace sysid
