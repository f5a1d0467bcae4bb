// Calls of the native engine: their inputs, checked, and how they run many passes side by side.
//
// A task is one run with one pack of parameter sets, a pack of runs with one set each, or one run with one block of
// derivatives; tasks share nothing that is written, so results do not depend on the number of threads.  Arrays come in
// the order of buffers.h, which is made from buffers.py.

#pragma once

#include <algorithm>
#include <atomic>
#include <memory>
#include <new>
#include <system_error>
#include <thread>

#include "residuals.h"

namespace sysid {

// An array of the caller: its numbers, the last axis fastest, and its shape.
struct Array {
  const double* data;
  const int64_t* shape;
  int64_t axes;
  int64_t count() const {
    int64_t all = 1;
    for (int64_t k = 0; k < axes; ++k) all *= shape[k];
    return all;
  }
};

// What is wrong with a call, in words; nothing if it was computed.
using Problem = const char*;

// How many threads a call may use; 0 stands for all that the machine has.
inline std::atomic<int64_t> thread_limit{0};

namespace {

// Which run and which set stand in each lane of a pack; lanes from `count` on repeat the last.
struct Lanes {
  int count;
  int64_t run[kLanes], set[kLanes];
};

class Inputs {
 public:
  Inputs(const Array* arrays, int64_t given, const Settings& settings, int64_t count) : arrays_(arrays) {
    if (given != count) {
      problem = "the native engine got another number of arrays than it was compiled for";
      return;
    }
    const int64_t* laws = shape(kLaws);
    runs = laws[1], axles = laws[2], sets = laws[3];
    coordinates = shape(kPosition)[2];
    body_sensors = shape(kBodyRows)[1];
    stations = shape(kRise)[2];
    frames = arrays_[kFrames].count() > 0 ? shape(kFrames)[2] : 0;
    if (axles > kMaxAxles) problem = "too many axles for the native engine";
    clock = {settings.samples, settings.substeps, settings.interval};
    edged = settings.edged != 0;
    elements.set(settings.elements);
    elements.ramps = static_cast<int>(settings.ramps);
    elements.stops = static_cast<int>(settings.stops);
    elements.rate_ramps = static_cast<int>(settings.rate_ramps);
    if (elements.equaliser && arrays_[kSharing].count() == 0)
      problem = "the native engine got shares of rockers that join no axles";
    channels.deflection = listed(settings.deflection_axles);
    channels.acceleration = listed(settings.acceleration_axles);
    channels.body = static_cast<int>(body_sensors);
    channels.rate = arrays_[kRateRows].count() > 0 ? static_cast<int>(shape(kRateRows)[1]) : 0;
    filter.direct = 0.0;
    for (int64_t k = 0; k < shape(kFilter)[0]; ++k) {
      const double* p = data(kFilter) + kPoleNumbers * k;
      filter.pole.push_back({{p[0], p[1]}, {p[2], p[3]}, {p[4], p[5]}, {p[6], p[7]}});
      filter.direct += p[6] * p[8] - p[7] * p[9];
    }
  }

  const double* data(int which) const { return arrays_[which].data; }
  const int64_t* shape(int which) const { return arrays_[which].shape; }

  // Constants of run r.
  Run<double> run(int64_t r) const {
    return constants<double>({r}, [&](int which, int64_t count) { return data(which) + r * count; });
  }

  // Constants of the runs of a pack; `numbers` holds them.
  Run<Pack> runs_of(const Lanes& lanes, std::vector<std::vector<Pack>>& numbers) const {
    const auto gathered = [&](int which, int64_t count) {
      std::vector<Pack> all(count);
      for (int64_t j = 0; j < count; ++j)
        for (int k = 0; k < kLanes; ++k) all[j][k] = data(which)[lanes.run[k] * count + j];
      numbers.push_back(std::move(all));
      return static_cast<const Pack*>(numbers.back().data());
    };
    return constants<Pack>({lanes.run, lanes.run + kLanes}, gathered);
  }

  // Packs of one run and several sets each.
  std::vector<Lanes> packs_of_sets() const {
    std::vector<Lanes> all;
    for (int64_t r = 0; r < runs; ++r)
      for (int64_t first = 0; first < sets; first += kLanes) {
        Lanes lanes;
        lanes.count = static_cast<int>(std::min<int64_t>(kLanes, sets - first));
        for (int k = 0; k < kLanes; ++k) lanes.run[k] = r, lanes.set[k] = std::min(first + k, sets - 1);
        all.push_back(lanes);
      }
    return all;
  }

  // All packs of runs and sets.  Where every run has one set, runs share packs; those that move alike stand together,
  // because they meet the bump at the same time.
  std::vector<Lanes> packs() const {
    if (sets > 1) return packs_of_sets();
    std::vector<Lanes> all;
    std::vector<int64_t> order(runs);
    for (int64_t r = 0; r < runs; ++r) order[r] = r;
    std::stable_sort(order.begin(), order.end(), [&](int64_t a, int64_t b) {
      const double *speed = data(kMotion), *start = speed + runs;
      return speed[a] < speed[b] || (speed[a] == speed[b] && start[a] < start[b]);
    });
    const int64_t count = (runs + kLanes - 1) / kLanes;
    for (int64_t p = 0; p < count; ++p) {
      const int64_t first = p * runs / count, end = (p + 1) * runs / count;
      Lanes lanes;
      lanes.count = static_cast<int>(end - first);
      for (int k = 0; k < kLanes; ++k) lanes.run[k] = order[std::min(first + k, end - 1)], lanes.set[k] = 0;
      all.push_back(lanes);
    }
    return all;
  }

  // Laws of a pack.
  Laws<Pack> laws(const Lanes& lanes) const {
    Laws<Pack> found = read<Pack>([&](int64_t row, int64_t i) { return pack(lanes, kLaws, row, i, axles); },
                                  [&](int64_t row, int64_t i) { return pack(lanes, kSides, row, i, axles); },
                                  [&](int which, int64_t i) { return of_runs(lanes, which, i); }, MotionChange<Pack>{});
    for (int64_t f = 0; f < frames; ++f) {
      found.frame_stiffness.push_back(pack(lanes, kFrames, 0, f, frames));
      found.frame_damping.push_back(pack(lanes, kFrames, 1, f, frames));
    }
    return found;
  }

  // Laws of run r with the derivatives with respect to the unknowns from `first` on.
  template <int T>
  Laws<Jet<T>> jets(int64_t r, int64_t first) const {
    const int64_t unknowns = shape(kLineariseTangents + kLawTangents)[3];
    const auto jet = [&](double value, const double* tangents) {
      Jet<T> x{};
      x.set_value(value);
      for (int64_t k = 1; k < T * kLanes && first + k - 1 < unknowns; ++k)
        x.d[k / kLanes][k % kLanes] = tangents[first + k - 1];
      return x;
    };
    const auto change = [&](int k) {
      return jet(0.0, data(kLineariseTangents + kMotionTangents) + (k * runs + r) * unknowns);
    };
    Laws<Jet<T>> found = read<Jet<T>>(
        [&](int64_t row, int64_t i) {
          const int64_t at = (row * runs + r) * axles + i;
          return jet(data(kLaws)[at], data(kLineariseTangents + kLawTangents) + at * unknowns);
        },
        [&](int64_t row, int64_t i) { return data(kSides)[(row * runs + r) * axles + i]; },
        [&](int which, int64_t i) { return data(which)[r * axles + i]; },
        MotionChange<Jet<T>>{change(0), change(1), change(2)});
    for (int64_t f = 0; f < frames; ++f) {
      const auto coefficient = [&](int64_t row) {
        const int64_t at = (row * runs + r) * frames + f;
        return jet(data(kFrames)[at], data(kLineariseTangents + kFrameTangents) + at * unknowns);
      };
      found.frame_stiffness.push_back(coefficient(0));
      found.frame_damping.push_back(coefficient(1));
    }
    for (int64_t begin = 0; begin < axles; begin += kLanes) {
      TireLaw<Pack> tires{};
      Pack load{}, growth{};
      for (int64_t k = 0; k < kLanes; ++k) {
        // Lanes beyond the last axle repeat it.
        const TireLaw<Jet<T>>& one = found.tire[std::min(begin + k, axles - 1)];
        tires.static_deflection[k] = value(one.static_deflection);
        tires.inverse_reference[k] = value(one.inverse_reference);
        tires.exponent[k] = value(one.exponent);
        tires.damping[k] = value(one.damping);
        load[k] = one.reference_load;
        growth[k] = one.growth;
      }
      found.across.push_back(tires);
      found.reference_load.push_back(load);
      found.growth.push_back(growth);
    }
    return found;
  }

  // Number i of a row (rows, R, width, S) for the runs and sets of a pack, and number i of a row (R, na, 1).
  Pack pack(const Lanes& lanes, int which, int64_t row, int64_t i, int64_t width) const {
    Pack x;
    for (int k = 0; k < kLanes; ++k) x[k] = data(which)[((row * runs + lanes.run[k]) * width + i) * sets + lanes.set[k]];
    return x;
  }
  Pack of_runs(const Lanes& lanes, int which, int64_t i) const {
    Pack x;
    for (int k = 0; k < kLanes; ++k) x[k] = data(which)[lanes.run[k] * axles + i];
    return x;
  }

  // All laws; coefficient(row, axle) and side(ramp, axle) give the rows of kLaws and kSides, known(row, axle)
  // what no set changes.
  template <class V, class Coefficient, class Side, class Known>
  Laws<V> read(Coefficient&& coefficient, Side&& side, Known&& known, const MotionChange<V>& change) const {
    Laws<V> found;
    found.change = change;
    for (int64_t i = 0; i < axles; ++i) {
      int64_t row = 0;
      const auto next = [&] { return coefficient(row++, i); };
      const Coefficients<V> c = read_coefficients<V>(elements, next);
      SuspensionLaw<V> law = suspension_law(elements, c);
      const TireLaw<V> tire = {c.static_deflection, reciprocal(c.reference_deflection), c.exponent, c.tire_damping,
                               known(kReferenceLoad, i), known(kGrowth, i)};
      const int springs = elements.ramps, stops = springs + elements.stops;
      for (int j = 0; j < stops + elements.rate_ramps; ++j) {
        std::vector<Ramp<V>>& ramps = j < springs ? law.ramps : j < stops ? law.stops : law.rate_ramps;
        const V at = next(), slope = next();
        ramps.push_back({at, slope, side(j, i)});
      }
      found.suspension.push_back(law);
      found.tire.push_back(tire);
    }
    return found;
  }

  Readings readings(int64_t r, int first) const {
    const int64_t c = channels.count();
    const auto of_run = [&](int which) { return by_channel(data(first + which) + r * c, clock.samples, runs * c, c); };
    const auto of_channels = [&](int which, int64_t from) { return numbers(first + which, from, c); };
    return {of_run(kValue),
            of_run(kMeasured),
            of_run(kCensored),
            of_channels(kNoiseSd, r * c),
            of_channels(kTempering, r * c),
            of_channels(kGainSd, 0),
            clock.samples};
  }

  Columns columns(int64_t r, int first) const {
    const int64_t n = shape(first + kColumnsResidual)[1], own = r * channels.count() * n;
    return {data(first + kColumnsResidual) + own * clock.samples, numbers(first + kColumnsGain, own, channels.count() * n),
            static_cast<int>(n)};
  }

  int64_t runs, axles, sets, coordinates, body_sensors, stations, frames;
  bool edged = false;
  Elements elements;
  Channels channels;
  Filter filter;
  Clock clock;
  Problem problem = nullptr;

 private:
  // Constants of runs; matrix(buffer, count) gives the `count` numbers of each.
  template <class M, class Matrix>
  Run<M> constants(const std::vector<int64_t>& of, Matrix&& matrix) const {
    const int64_t rows = 2 * axles + coordinates, each = axles * stations;
    Run<M> run;
    run.axles = static_cast<int>(axles);
    run.body_sensors = static_cast<int>(body_sensors);
    run.position = matrix(kPosition, rows * coordinates);
    run.rate = matrix(kRate, rows * coordinates);
    run.acceleration = matrix(kAcceleration, coordinates * 2 * axles);
    run.inverse_unsprung = matrix(kInverseUnsprung, axles);
    run.static_load = matrix(kStaticLoad, axles);
    run.body_rows = matrix(kBodyRows, body_sensors * coordinates);
    if (channels.rate > 0) run.rate_rows = matrix(kRateRows, channels.rate * coordinates);
    run.axle_x = data(kAxleX);
    if (arrays_[kWheel].count() > 0)
      run.beams = {matrix(kWheel, axles * axles), matrix(kTirePush, axles * axles), matrix(kBeamPull, axles * axles),
                   matrix(kCarries, axles)};
    if (arrays_[kSharing].count() > 0) run.sharing = matrix(kSharing, axles * axles);
    if (frames > 0)
      run.frames = {static_cast<int>(frames), matrix(kFrameSelect, frames * coordinates),
                    matrix(kFramePush, coordinates * frames)};
    run.elements = elements;
    const bool footprint = arrays_[kStretch].count() > 0;
    // One footprint map may serve all runs.
    const int64_t maps = footprint ? shape(kStretch)[1] : 1;
    for (const int64_t r : of) {
      const int64_t own = maps == 1 ? 0 : r * each;
      run.road.push_back({data(kRise) + r * each, footprint ? data(kStretch) + own : nullptr,
                          footprint ? data(kDrag) + own : nullptr, stations, maps * each, footprint && maps < runs,
                          edged, data(kGrid)[0], data(kGrid)[1], data(kPolynomial)});
    }
    const auto motion = [&](int number) {
      M x{};
      for (size_t k = 0; k < of.size(); ++k) set_lane(x, k, data(kMotion)[number * runs + of[k]]);
      return x;
    };
    run.motion = {motion(0), motion(1), motion(2)};
    run.edged = edged;
    return run;
  }

  std::vector<double> numbers(int which, int64_t from, int64_t count) const {
    return {data(which) + from, data(which) + from + count};
  }

  static std::vector<int> listed(const AxleList& axles) { return {axles.at, axles.at + axles.count}; }

  const Array* arrays_;
};

int64_t threads() {
  const int64_t limit = thread_limit;
  return limit > 0 ? limit : std::max<int64_t>(1, std::thread::hardware_concurrency());
}

// Runs task(0) ... task(count - 1) on the threads that a call may use; throws if memory does not suffice.
template <class Task>
void share(int64_t count, Task&& task) {
  std::atomic<int64_t> next{0};
  std::atomic<bool> exhausted{false};
  const auto work = [&] {
    [[maybe_unused]] const NoSubnormals held;
    try {
      for (int64_t k = next++; k < count; k = next++) task(k);
    } catch (const std::bad_alloc&) {
      exhausted = true;
    }
  };
  std::vector<std::thread> others;
  const int64_t most = std::min(threads(), count);
  try {
    for (int64_t k = 1; k < most; ++k) others.emplace_back(work);
  } catch (const std::system_error&) {
    // The system grants no further thread: those that there are do the work.
  }
  work();
  for (std::thread& other : others) other.join();
  if (exhausted) throw std::bad_alloc();
}

#ifdef SYSID_COORDINATES
// Compiled for one vehicle's number of body coordinates alone: a third of the time.
constexpr int kFewest = SYSID_COORDINATES, kMost = SYSID_COORDINATES;
#else
constexpr int kFewest = kLeastCoordinates, kMost = kMostCoordinates;
#endif

Problem finish(bool known) {
  return known ? nullptr : "the native engine is not compiled for so many body coordinates";
}

// Writes row `row` of a pack's signals to out (R, rows, S).
void store(const Pack& x, double* out, int64_t rows, int64_t row, const Lanes& lanes, int64_t sets) {
  for (int k = 0; k < lanes.count; ++k) out[(lanes.run[k] * rows + row) * sets + lanes.set[k]] = x[k];
}

// Readings and columns of all runs.
struct Measured {
  std::vector<Readings> readings;
  std::vector<Columns> columns;

  Measured(const Inputs& in, int first_reading, int first_column) : readings(in.runs), columns(in.runs) {
    share(in.runs, [&](int64_t r) {
      readings[r] = in.readings(r, first_reading);
      columns[r] = in.columns(r, first_column);
    });
  }
};

// Checks a call and computes it: `count` arrays are expected, `given` are there.
template <Problem (*function)(const Inputs&, double* const*)>
Problem called(const Array* arrays, int64_t given, const Settings& settings, double* const* results, int64_t count) {
  try {
    const Inputs in(arrays, given, settings, count);
    return in.problem != nullptr ? in.problem : function(in, results);
  } catch (const std::bad_alloc&) {
    return kNoMemory;
  }
}

}  // namespace
}  // namespace sysid

extern "C" {
// The description that this library was compiled with.
const char* sysid_fingerprint() { return sysid::kFingerprint; }
// All calls from now on use at most so many threads; 0: as many as the machine has.
void sysid_use_threads(int64_t limit) { sysid::thread_limit = limit; }
}

#define SYSID_ENTRY(name, count)                                                                              \
  extern "C" const char* sysid_##name(const sysid::Array* arrays, int64_t given, const sysid::Settings* settings, \
                                      double* const* results) {                                               \
    return sysid::called<sysid::name>(arrays, given, *settings, results, sysid::count);                       \
  }
