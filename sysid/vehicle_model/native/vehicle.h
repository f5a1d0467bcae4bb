// One run of the planar vehicle over a bump: the equations of simulation.py and filters.py.

#pragma once

#include <utility>
#include <vector>

#include "suspension.h"

namespace sysid {

// Constants of a run are numbers M: of one run, or a Pack with one of the run of each lane.

// Rigid beams that carry axle groups, as in StackedBeams: (na, na), (na, na), (na, na), (na,); null without groups.
template <class M>
struct Beams {
  const M *wheel = nullptr, *tire = nullptr, *pull = nullptr, *carries = nullptr;
};

// Bending modes of frames, as in StackedFrames: (count, nb), (nb, count).
template <class M>
struct Frames {
  int count = 0;
  const M *select = nullptr, *push = nullptr;
};

// How a run moves along the road (equations of motion.py): axle 1 over the start of the bump at `start` [s] with `speed`
// [m/s], and a constant acceleration [m/s2].
template <class M>
struct Motion {
  M speed, start, acceleration;
  // Time from the start [s], at most (in size) where the run stands.
  M since_start(double time) const {
    const M tau = time - start;
    return select(speed + acceleration * tau < 0.0, -speed / acceleration, tau);
  }
  M travelled(double time) const {
    const M tau = since_start(time);
    return tau * (speed + 0.5 * acceleration * tau);
  }
  M speed_at(double time) const { return speed + acceleration * since_start(time); }
};

// Derivatives of a run's motion (their values are zero).
template <class V>
struct MotionChange {
  V speed, start, acceleration;
};

// Constants of one run or of several (matrices as in StackedMatrices): na axles, nr body sensors.
template <class M>
struct Run {
  int axles, body_sensors;
  const M *position, *rate, *acceleration, *inverse_unsprung, *static_load, *body_rows;
  const double* axle_x;
  Beams<M> beams;
  const M* sharing = nullptr;  // (na, na) means over the axles of every rocker, null without rockers
  Frames<M> frames;
  std::vector<RoadTable> road;  // of each lane
  Motion<M> motion;
  double growth;
  Elements elements;
};

// Tire of one axle: u_0 [m], 1/u_ref [1/m], n [-], c_t [N s/m], F_ref [N].
template <class V>
struct TireLaw {
  V static_deflection, inverse_reference, exponent, damping;
  Scalar<V> reference_load;
};

// Laws of all axles, and derivatives of the run's motion.
template <class V>
struct Laws {
  std::vector<SuspensionLaw<V>> suspension;
  std::vector<TireLaw<V>> tire;
  std::vector<V> frame_stiffness, frame_damping;  // (2 pi f)^2 [1/s2], 2 zeta (2 pi f) [1/s]
  MotionChange<V> change;
  std::vector<TireLaw<Pack>> across;  // for jets: values of the tires' coefficients, lanes are axles
  std::vector<Pack> reference_load;   // [N], lanes are axles
};

// Positions and rates of body and unsprung coordinates, and friction states.
template <class V, int NB>
struct State {
  V body[NB], body_rate[NB];
  V axle[kMaxAxles], axle_rate[kMaxAxles], slip[kMaxAxles];
};

// Accelerations and forces of one stage; extension and its rate at unsprung coordinates.
template <class V, int NB>
struct Forces {
  V body[NB];
  V axle[kMaxAxles], unclipped[kMaxAxles], horizontal[kMaxAxles], pull[kMaxAxles], extension[kMaxAxles],
      rate[kMaxAxles], damper[kMaxAxles];  // the last: of the symmetric damper
};

// Where each wheel is: how far it is ahead of the looked-up road, its forward speed, its rise and rate of rise.
template <class V>
struct Wheels {
  V advance[kMaxAxles], speed[kMaxAxles];
  const V *rise, *rise_rate;
};

// y = M x for a matrix (n, n) that is mostly zeros.
template <class V, class M>
inline void transform(const M* matrix, int n, const V* x, V* y) {
  for (int i = 0; i < n; ++i) {
    V sum{};
    for (int k = 0; k < n; ++k)
      if (any(matrix[i * n + k] != 0.0)) accumulate(sum, matrix[i * n + k], x[k]);
    y[i] = sum;
  }
}

// ------------------------------------------------------------------------------------------------------------- contact

// Unclipped vertical force of every tire and, where the road is not flat, H/V.
template <class M>
void contacts(const Run<M>& run, const Laws<Pack>& laws, const PointFor<M>* road, double, const Wheels<Pack>& wheel,
              Pack* unclipped, Pack* drag) {
  for (int i = 0; i < run.axles; ++i) {
    const TireLaw<Pack>& law = laws.tire[i];
    Squash<Pack> now;
    if (road[i].flat) {
      now.deflection = law.static_deflection - wheel.rise[i];
      now.rate = -wheel.rise_rate[i];
    } else {
      now = squash(road_rows(road[i]), law.static_deflection, wheel.advance[i], wheel.speed[i], wheel.rise[i],
                   wheel.rise_rate[i]);
      drag[i] = now.drag;
    }
    unclipped[i] = tire_force(now.deflection, now.rate, law.inverse_reference, law.exponent, law.damping,
                              law.reference_load, run.growth);
  }
}

// Inputs of a contact; a row of partial derivatives has one lane for each, behind the lane of the value.
enum { kByRest = 1, kByAdvance, kBySpeed, kByRise, kByRiseRate, kByAhead };
using Partials = Jet<8 / kLanes>;

inline Partials partials(double value, int input, double slope) {
  Partials x{};
  x.d[input / kLanes][input % kLanes] = slope;
  x.d[0][0] = value;
  return x;
}
inline double slope(const Partials& x, int input) { return x.d[input / kLanes][input % kLanes]; }

// Rows of the road; looked up `ahead` further on, the value moves with the next derivative.
inline RoadRows<Partials> ahead_rows(const RoadPoint& point) {
  const MapRow* order = point.order;
  const auto row = [&](int n, int which) { return partials(order[n][which], kByAhead, order[n + 1][which]); };
  RoadRows<Partials> rows;
  rows.rise = row(0, 0), rows.slope = row(1, 0), rows.second = row(2, 0), rows.third = row(3, 0);
  for (int n = 0; n < 3; ++n) {
    for (int which = 0; which < 4; ++which) rows.stretch[which][n] = row(n, 1 + which);
    for (int which = 0; which < 3; ++which) rows.drag[which][n] = row(n, 5 + which);
  }
  return rows;
}

// The same for jets: first the partial derivatives of the squash of each wheel that is not on flat road, then those of
// all tires' forces with axles as lanes, then the chain rule along each row of derivatives.
template <int T>
void contacts(const Run<double>& run, const Laws<Jet<T>>& laws, const RoadPoint* road, double time,
              const Wheels<Jet<T>>& wheel, Jet<T>* unclipped, Jet<T>* drag) {
  enum { kDeflection, kRate, kInverse, kExponent, kDamping, kForceInputs };
  using Outer = Local<kForceInputs>;
  Squash<Partials> squashed[kLanes];
  // How far the run is ahead of where the road is looked up.
  const double tau = run.motion.since_start(time);
  const Jet<T> ahead = tau * laws.change.speed + 0.5 * tau * tau * laws.change.acceleration -
                       run.motion.speed_at(time) * laws.change.start;
  for (int first = 0; first < run.axles; first += kLanes) {
    const int count = run.axles - first < kLanes ? run.axles - first : kLanes;
    const TireLaw<Pack>& tires = laws.across[first / kLanes];
    Pack deflection = tires.static_deflection, rate{};
    for (int k = 0; k < count; ++k) {
      const int i = first + k;
      const double rise = value(wheel.rise[i]), rise_rate = value(wheel.rise_rate[i]);
      if (road[i].flat) {
        deflection[k] -= rise;
        rate[k] = -rise_rate;
        continue;
      }
      squashed[k] = squash(ahead_rows(road[i]), partials(tires.static_deflection[k], kByRest, 1.0),
                           partials(value(wheel.advance[i]), kByAdvance, 1.0),
                           partials(value(wheel.speed[i]), kBySpeed, 1.0), partials(rise, kByRise, 1.0),
                           partials(rise_rate, kByRiseRate, 1.0));
      deflection[k] = value(squashed[k].deflection);
      rate[k] = value(squashed[k].rate);
    }
    const Outer force = tire_force(variable<kForceInputs>(deflection, kDeflection), variable<kForceInputs>(rate, kRate),
                                   variable<kForceInputs>(tires.inverse_reference, kInverse),
                                   variable<kForceInputs>(tires.exponent, kExponent),
                                   variable<kForceInputs>(tires.damping, kDamping),
                                   laws.reference_load[first / kLanes], run.growth);
    for (int k = 0; k < count; ++k) {
      const int i = first + k;
      const TireLaw<Jet<T>>& law = laws.tire[i];
      const double by_deflection = force.d[kDeflection][k], by_rate = force.d[kRate][k];
      Jet<T> slopes = force.d[kInverse][k] * law.inverse_reference + force.d[kExponent][k] * law.exponent +
                      force.d[kDamping][k] * law.damping;
      if (road[i].flat) {
        slopes += by_deflection * (law.static_deflection - wheel.rise[i]) - by_rate * wheel.rise_rate[i];
      } else {
        const Partials by = by_deflection * squashed[k].deflection + by_rate * squashed[k].rate;
        slopes += slope(by, kByRest) * law.static_deflection + slope(by, kByAdvance) * wheel.advance[i] +
                  slope(by, kBySpeed) * wheel.speed[i] + slope(by, kByRise) * wheel.rise[i] +
                  slope(by, kByRiseRate) * wheel.rise_rate[i] + slope(by, kByAhead) * ahead;
        const Partials& h = squashed[k].drag;
        drag[i] = slope(h, kByRest) * law.static_deflection + slope(h, kByAdvance) * wheel.advance[i] +
                  slope(h, kByRise) * wheel.rise[i] + slope(h, kByAhead) * ahead;
        drag[i].set_value(value(h));
      }
      slopes.set_value(force.v[k]);
      unclipped[i] = slopes;
    }
  }
}

// Forward speed of a run.
template <class M>
inline Pack forward_speed(const Run<M>& run, const Laws<Pack>&, double time) {
  return run.motion.speed_at(time) - Pack{};
}
template <int T>
inline Jet<T> forward_speed(const Run<double>& run, const Laws<Jet<T>>& laws, double time) {
  const double tau = run.motion.since_start(time), now = run.motion.speed_at(time);
  if (now <= 0.0) return Jet<T>{};
  const MotionChange<Jet<T>>& change = laws.change;
  return now + (change.speed + tau * change.acceleration - run.motion.acceleration * change.start);
}

// -------------------------------------------------------------------------------------------------------------- forces

// What axles and frame feel of the springs' forces through rockers: S + s (mean S - S).
template <class V, class M>
inline void share(const Run<M>& run, const Laws<V>& laws, V* force) {
  V mean[kMaxAxles];
  transform(run.sharing, run.axles, force, mean);
  for (int i = 0; i < run.axles; ++i) force[i] += laws.suspension[i].load_share * (mean[i] - force[i]);
}

// Where in a step a stage stands, for friction: time from its start, and extension and rate there.
template <class V>
struct StageOfStep {
  double tau;
  const V *extension, *rate;
};

// Accelerations and forces in a state:
//   axles: m_u z'' = V - static load + pull,      bodies: b'' = A [pull; H] - M^-1 (tilt b + hold b').
// `stage` is null at the start of a step, where the friction state is the step's own.
template <class V, class M, int NB>
void forces(const Run<M>& run, const Laws<V>& laws, const PointFor<M>* road, double time, const State<V, NB>& state,
            const V* slip, const StageOfStep<V>* stage, Forces<V, NB>& out) {
  const int na = run.axles;
  const bool beams = run.beams.wheel != nullptr;
  Wheels<V> wheel;
  wheel.rise = state.axle;
  wheel.rise_rate = state.axle_rate;
  V drag[kMaxAxles], rise[kMaxAxles], rise_rate[kMaxAxles];
  if (beams) {
    transform(run.beams.wheel, na, state.axle, rise);
    transform(run.beams.wheel, na, state.axle_rate, rise_rate);
    wheel.rise = rise;
    wheel.rise_rate = rise_rate;
  }
  const V nominal = forward_speed(run, laws, time);
  for (int i = 0; i < na; ++i) {
    const M *up = run.position + i * NB, *up_rate = run.rate + i * NB;
    V above = -state.axle[i], above_rate = -state.axle_rate[i];
    for (int j = 0; j < NB; ++j) {
      accumulate(above, up[j], state.body[j]);
      accumulate(above_rate, up_rate[j], state.body_rate[j]);
    }
    out.extension[i] = above;
    out.rate[i] = above_rate;
    if (road[i].flat) continue;
    const M *along = run.position + (na + i) * NB, *along_rate = run.rate + (na + i) * NB;
    V advance{}, speed = nominal;
    for (int j = 0; j < NB; ++j) {
      accumulate(advance, along[j], state.body[j]);
      accumulate(speed, along_rate[j], state.body_rate[j]);
    }
    wheel.advance[i] = advance;
    wheel.speed[i] = speed;
  }
  contacts(run, laws, road, time, wheel, out.unclipped, drag);
  V body[NB];
  for (int j = 0; j < NB; ++j) {
    const M *tilt = run.position + (2 * na + j) * NB, *hold = run.rate + (2 * na + j) * NB;
    body[j] = V{};
    for (int l = 0; l < NB; ++l) {
      accumulate(body[j], tilt[l], state.body[l]);
      accumulate(body[j], hold[l], state.body_rate[l]);
    }
  }
  for (int f = 0; f < run.frames.count; ++f) {
    V amplitude{}, swing{};
    for (int j = 0; j < NB; ++j) {
      accumulate(amplitude, run.frames.select[f * NB + j], state.body[j]);
      accumulate(swing, run.frames.select[f * NB + j], state.body_rate[j]);
    }
    const V straightening = laws.frame_stiffness[f] * amplitude + laws.frame_damping[f] * swing;
    for (int j = 0; j < NB; ++j) accumulate(body[j], run.frames.push[j * run.frames.count + f], straightening);
  }
  const bool linear = run.elements.linear();
  if (!linear) {
    for (int i = 0; i < na; ++i) {
      const SuspensionLaw<V>& law = laws.suspension[i];
      out.pull[i] = spring_force(run.elements, law, out.extension[i]);
      if (!run.elements.friction) continue;
      const V phi = stage == nullptr ? slip[i]
                                     : slip_at_stage(law, slip[i], stage->extension[i], stage->rate[i], stage->tau,
                                                     out.extension[i]);
      out.pull[i] += law.friction * phi;
    }
    if (run.elements.equaliser) share(run, laws, out.pull);
  }
  for (int i = 0; i < na; ++i) {
    const SuspensionLaw<V>& law = laws.suspension[i];
    V pull;
    if (linear) {
      pull = law.stiffness * out.extension[i] + law.damping * out.rate[i];
    } else {
      out.damper[i] = symmetric_damper(run.elements, law, out.rate[i]);
      pull = out.pull[i] + damper_force(run.elements, law, out.rate[i], out.damper[i]);
      if (run.elements.stops > 0) pull += ramp_force(law.stops, out.extension[i]);
    }
    if (beams) pull = run.beams.carries[i] * pull;
    const V vertical = positive(out.unclipped[i]);
    out.pull[i] = pull;
    out.axle[i] = -run.static_load[i] + vertical;
    if (!beams) out.axle[i] = run.inverse_unsprung[i] * (out.axle[i] + pull);
    for (int j = 0; j < NB; ++j) accumulate(body[j], run.acceleration[j * 2 * na + i], pull);
    if (road[i].flat) {
      out.horizontal[i] = V{};
    } else {
      out.horizontal[i] = drag[i] * vertical;
      for (int j = 0; j < NB; ++j) accumulate(body[j], run.acceleration[j * 2 * na + na + i], out.horizontal[i]);
    }
  }
  for (int j = 0; j < NB; ++j) out.body[j] = body[j];
  if (beams) {
    V pushed[kMaxAxles], pulled[kMaxAxles];
    transform(run.beams.tire, na, out.axle, pushed);
    transform(run.beams.pull, na, out.pull, pulled);
    for (int i = 0; i < na; ++i) out.axle[i] = pushed[i] + pulled[i];
  }
}

// Mean accelerations over the step, and their first moments, that the stages miss at the corners of tire contact and
// suspension law.
template <class V, int NB>
struct Missed {
  V axle[kMaxAxles], axle_moment[kMaxAxles], body[NB], body_moment[NB];
  bool at_axles, at_bodies;
};

template <class V, class M, int NB>
void find_missed(const Run<M>& run, const Laws<V>& laws, const std::vector<Forces<V, NB>>& stage, Missed<V, NB>& out) {
  const int na = run.axles;
  V tire[kMaxAxles], tire_moment[kMaxAxles], pull[kMaxAxles]{}, pull_moment[kMaxAxles]{};
  out.at_axles = out.at_bodies = false;
  for (int i = 0; i < na; ++i) {
    tire[i] = tire_moment[i] = V{};
    if (missed_by_stages(stage[0].unclipped[i], stage[1].unclipped[i], stage[2].unclipped[i], stage[3].unclipped[i],
                         tire[i], tire_moment[i]))
      out.at_axles = true;
  }
  if (run.elements.corners()) {
    const auto at_stages = [&](int i, V(&extension)[4], V(&rate)[4]) {
      for (int k = 0; k < 4; ++k) extension[k] = stage[k].extension[i], rate[k] = stage[k].rate[i];
    };
    V extension[4], rate[4], damper[4];
    for (int i = 0; i < na; ++i) {
      MissedForce<V> missed;
      if (run.elements.ramps > 0) {
        at_stages(i, extension, rate);
        missed.add(laws.suspension[i].ramps, extension);
      }
      pull[i] = missed.impulse;
      pull_moment[i] = missed.moment;
      if (missed.found) out.at_axles = out.at_bodies = true;
    }
    if (run.elements.equaliser && out.at_bodies) share(run, laws, pull), share(run, laws, pull_moment);
    for (int i = 0; i < na; ++i) {
      MissedForce<V> missed;
      at_stages(i, extension, rate);
      for (int k = 0; k < 4; ++k) damper[k] = stage[k].damper[i];
      add_missed(run.elements, laws.suspension[i], extension, rate, damper, missed);
      if (missed.found) {
        out.at_axles = out.at_bodies = true;
        pull[i] += missed.impulse;
        pull_moment[i] += missed.moment;
      }
      if (run.beams.carries == nullptr) continue;
      pull[i] = run.beams.carries[i] * pull[i];
      pull_moment[i] = run.beams.carries[i] * pull_moment[i];
    }
  }
  if (!out.at_axles) return;
  const auto axles = [&](const V* from_tire, const V* from_pull, V* acceleration) {
    if (run.beams.wheel == nullptr) {
      for (int i = 0; i < na; ++i)
        acceleration[i] = run.inverse_unsprung[i] * (out.at_bodies ? from_tire[i] + from_pull[i] : from_tire[i]);
      return;
    }
    transform(run.beams.tire, na, from_tire, acceleration);
    if (!out.at_bodies) return;
    V pulled[kMaxAxles];
    transform(run.beams.pull, na, from_pull, pulled);
    for (int i = 0; i < na; ++i) acceleration[i] += pulled[i];
  };
  axles(tire, pull, out.axle);
  axles(tire_moment, pull_moment, out.axle_moment);
  if (!out.at_bodies) return;
  for (int j = 0; j < NB; ++j) {
    out.body[j] = out.body_moment[j] = V{};
    for (int i = 0; i < na; ++i) {
      out.body[j] += run.acceleration[j * 2 * na + i] * pull[i];
      out.body_moment[j] += run.acceleration[j * 2 * na + i] * pull_moment[i];
    }
  }
}

// ------------------------------------------------------------------------------------------------- sensors and filter

// Signals in the order of the channels: deflections, axle accelerations, body accelerations.
struct Channels {
  std::vector<int> deflection, acceleration;
  int body;
  int count() const { return static_cast<int>(deflection.size() + acceleration.size()) + body; }
};

template <int NB, class V, class M>
void observe(const Run<M>& run, const Channels& channels, const V* extension, const V* axle, const V* body, V* signal) {
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
};

// Integrates one run, or one in each lane, and calls sink(sample, forces, state, shown) at every sample.
//
// The step is the classical fourth-order Runge-Kutta scheme in its second-order (Nystrom) form with the exact integral
// of forces at their corners.  The start is the static equilibrium, so nothing moves before a wheel reaches the bump.
template <class V, class M, int NB, bool Filtered, class Sink>
void integrate(const Run<M>& run, const Laws<V>& laws, const Channels& channels, const Filter& filter, const Clock& clock,
               Sink&& sink) {
  const int na = run.axles, nc = channels.count();
  const double h = clock.interval / static_cast<double>(clock.substeps), half = 0.5 * h;
  const double half_step = clock.interval / static_cast<double>(2 * clock.substeps);
  std::vector<RoadUnderWheel<M>> wheels;
  for (int i = 0; i < na; ++i) wheels.emplace_back(run.road, i);
  std::vector<PointFor<M>> points(3 * na);
  PointFor<M>*road = &points[0], *road_middle = &points[na], *road_end = &points[2 * na];
  const auto look_up = [&](int64_t half_steps, PointFor<M>* at) {
    const M travelled = run.motion.travelled(static_cast<double>(half_steps) * half_step);
    Where<M> felt{};
    for (int i = 0; i < na; ++i) felt |= wheels[i].look_up(travelled - run.axle_x[i], at[i]);
    return felt;
  };
  FilterMemory<V> memory(filter, nc);
  std::vector<V> now(nc), middle(nc), shown(nc);
  std::vector<State<V, NB>> states(2);
  State<V, NB>&at = states[0], &trial = states[1];
  std::vector<Forces<V, NB>> stage(4);
  Forces<V, NB>&first = stage[0], &second = stage[1], &third = stage[2], &fourth = stage[3];
  Missed<V, NB> missed;

  Where<M> resting = opposite(look_up(0, road));
  // Forces cancel up to rounding before a wheel meets the bump: what is at rest stays at rest.
  const auto hold = [&](Forces<V, NB>& of) {
    if (!any(resting)) return;
    for (int j = 0; j < NB; ++j) clear(resting, of.body[j]);
    for (int i = 0; i < na; ++i) clear(resting, of.axle[i]), clear(resting, of.pull[i]);
  };
  const int64_t steps = (clock.samples - 1) * clock.substeps + 1;
  for (int64_t step = 0; step < steps; ++step) {
    const double time = static_cast<double>(step) * h;
    const bool sampled = step % clock.substeps == 0;
    if (step > 0) std::swap(road, road_end);
    const Where<M> middle_felt = look_up(2 * step + 1, road_middle), end_felt = look_up(2 * step + 2, road_end);
    resting = resting & opposite(middle_felt | end_felt);
    const bool all_rest = !any(opposite(resting));
    if (!all_rest || step == 0) forces<V, M, NB>(run, laws, road, time, at, at.slip, nullptr, first);
    hold(first);
    if (Filtered || sampled) observe<NB>(run, channels, first.extension, first.axle, first.body, now.data());
    if (sampled) {
      if (Filtered) memory.show(now.data(), shown.data());
      sink(step / clock.substeps, first, at, Filtered ? shown.data() : now.data());
    }
    if (all_rest || step + 1 == steps) continue;

    const StageOfStep<V> at_middle{half, first.extension, first.rate}, at_end{h, first.extension, first.rate};
    for (int j = 0; j < NB; ++j) {
      trial.body[j] = at.body[j] + half * at.body_rate[j];
      trial.body_rate[j] = at.body_rate[j] + half * first.body[j];
    }
    for (int i = 0; i < na; ++i) {
      trial.axle[i] = at.axle[i] + half * at.axle_rate[i];
      trial.axle_rate[i] = at.axle_rate[i] + half * first.axle[i];
    }
    forces<V, M, NB>(run, laws, road_middle, time + half, trial, at.slip, &at_middle, second);
    hold(second);
    for (int j = 0; j < NB; ++j) {
      trial.body[j] += half * half * first.body[j];
      trial.body_rate[j] = at.body_rate[j] + half * second.body[j];
    }
    for (int i = 0; i < na; ++i) {
      trial.axle[i] += half * half * first.axle[i];
      trial.axle_rate[i] = at.axle_rate[i] + half * second.axle[i];
    }
    forces<V, M, NB>(run, laws, road_middle, time + half, trial, at.slip, &at_middle, third);
    hold(third);
    for (int j = 0; j < NB; ++j) {
      trial.body[j] = at.body[j] + h * at.body_rate[j] + h * half * second.body[j];
      trial.body_rate[j] = at.body_rate[j] + h * third.body[j];
    }
    for (int i = 0; i < na; ++i) {
      trial.axle[i] = at.axle[i] + h * at.axle_rate[i] + h * half * second.axle[i];
      trial.axle_rate[i] = at.axle_rate[i] + h * third.axle[i];
    }
    forces<V, M, NB>(run, laws, road_end, time + h, trial, at.slip, &at_end, fourth);
    hold(fourth);

    const auto advance = [&](V& x, V& v, const V& a1, const V& a2, const V& a3, const V& a4) {
      const V between = a2 + a3;
      x += h * v + h * h / 6.0 * (a1 + between);
      v += h / 6.0 * (a1 + 2.0 * between + a4);
    };
    for (int j = 0; j < NB; ++j)
      advance(at.body[j], at.body_rate[j], first.body[j], second.body[j], third.body[j], fourth.body[j]);
    for (int i = 0; i < na; ++i)
      advance(at.axle[i], at.axle_rate[i], first.axle[i], second.axle[i], third.axle[i], fourth.axle[i]);
    find_missed(run, laws, stage, missed);
    if (missed.at_axles) {
      for (int i = 0; i < na; ++i) {
        at.axle[i] += h * h * missed.axle_moment[i];
        at.axle_rate[i] += h * missed.axle[i];
      }
    }
    if (missed.at_bodies) {
      for (int j = 0; j < NB; ++j) {
        at.body[j] += h * h * missed.body_moment[j];
        at.body_rate[j] += h * missed.body[j];
      }
    }
    if (run.elements.friction) {
      for (int i = 0; i < na; ++i) {
        const M* up = run.position + i * NB;
        V end = up[0] * at.body[0] - at.axle[i], end_rate = up[0] * at.body_rate[0] - at.axle_rate[i];
        for (int j = 1; j < NB; ++j) end += up[j] * at.body[j], end_rate += up[j] * at.body_rate[j];
        at.slip[i] = slip_after_step(laws.suspension[i], at.slip[i], first.extension[i], first.rate[i], end, end_rate, h);
      }
    }
    if (!Filtered) continue;
    // At a corner the filter's quadratic through start, middle and end has the exact impulse of the force.
    for (int i = 0; i < na; ++i) {
      trial.axle[i] = 0.5 * (second.extension[i] + third.extension[i]);
      trial.axle_rate[i] = 0.5 * (second.axle[i] + third.axle[i]);
      if (missed.at_axles) trial.axle_rate[i] += 1.5 * missed.axle[i];
    }
    for (int j = 0; j < NB; ++j) {
      trial.body[j] = 0.5 * (second.body[j] + third.body[j]);
      if (missed.at_bodies) trial.body[j] += 1.5 * missed.body[j];
    }
    observe<NB>(run, channels, trial.axle, trial.axle_rate, trial.body, middle.data());
    memory.advance(now.data(), middle.data());
  }
}

}  // namespace sysid
