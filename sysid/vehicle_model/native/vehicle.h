// The planar vehicle at one instant: accelerations and forces in a state (equations of simulation.py).

#pragma once

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

// Constants of one run or of several (matrices as in StackedMatrices): na axles, nr body sensors; `rate_rows` null
// without sensors of pitch rate.
template <class M>
struct Run {
  int axles, body_sensors;
  const M *position, *rate, *acceleration, *inverse_unsprung, *static_load, *body_rows, *rate_rows = nullptr;
  const double* axle_x;
  Beams<M> beams;
  const M* sharing = nullptr;  // (na, na) means over the axles of every rocker, null without rockers
  Frames<M> frames;
  std::vector<RoadTable> road;  // of each lane
  Motion<M> motion;
  bool edged = false;  // the road is looked up where the wheels are, not by its Taylor series
  Elements elements;
};

// Tire of one axle: u_0 [m], 1/u_ref [1/m], n [-], c_t [N s/m], F_ref [N], how c_t grows with the contact [-].
template <class V>
struct TireLaw {
  V static_deflection, inverse_reference, exponent, damping;
  Scalar<V> reference_load, growth;
};

// Laws of all axles, and derivatives of the run's motion.
template <class V>
struct Laws {
  std::vector<SuspensionLaw<V>> suspension;
  std::vector<TireLaw<V>> tire;
  std::vector<V> frame_stiffness, frame_damping;  // (2 pi f)^2 [1/s2], 2 zeta (2 pi f) [1/s]
  MotionChange<V> change;
  std::vector<TireLaw<Pack>> across;  // for jets: values of the tires' coefficients, lanes are axles
  std::vector<Pack> reference_load, growth;  // [N], [-], lanes are axles
};

// States inside suspensions: phi of friction, and the rate of dampers in bushings [m/s].
template <class V>
struct Inner {
  V slip[kMaxAxles], damper_rate[kMaxAxles];
};

// Positions and rates of body and unsprung coordinates, and states inside suspensions.
template <class V, int NB>
struct State {
  V body[NB], body_rate[NB];
  V axle[kMaxAxles], axle_rate[kMaxAxles];
  Inner<V> inner;
};

// Accelerations and forces of one stage; extension and its rate at unsprung coordinates; rates of the body where they are
// observed.
template <class V, int NB>
struct Forces {
  V body[NB], body_rate[NB];
  V axle[kMaxAxles], unclipped[kMaxAxles], horizontal[kMaxAxles], pull[kMaxAxles], extension[kMaxAxles],
      rate[kMaxAxles], damper[kMaxAxles], damper_rate[kMaxAxles];  // of the symmetric damper, and of dampers in bushings
  const V& of_damper(const Elements& has, int i) const { return has.damper_bushing ? damper_rate[i] : rate[i]; }
};

// Where each wheel is: how far it is ahead of the looked-up road, its forward speed, its rise and rate of rise.
template <class V>
struct Wheels {
  V advance[kMaxAxles], speed[kMaxAxles];
  const V *rise, *rise_rate;
};

// y += A x for a matrix (rows, columns) with `stride` numbers from row to row.
template <int rows, class V, class M>
inline void add_product(const M* matrix, int stride, int columns, const V* x, V* y) {
  for (int k = 0; k < columns; ++k)
    for (int j = 0; j < rows; ++j) accumulate(y[j], matrix[j * stride + k], x[k]);
}
template <int rows, int columns, class V, class M>
inline void add_product(const M* matrix, int stride, const V* x, V* y) {
  add_product<rows>(matrix, stride, columns, x, y);
}

// What bodies are above axles: y = A body - axle, with a matrix (na, NB).
template <int NB, class V, class M>
inline void above_axles(const M* matrix, int axles, const V* body, const V* axle, V* y) {
  for (int i = 0; i < axles; ++i) {
    V above = -axle[i];
    for (int j = 0; j < NB; ++j) accumulate(above, matrix[i * NB + j], body[j]);
    y[i] = above;
  }
}

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
template <class V, class M>
void contacts(const Run<M>& run, const Laws<V>& laws, const PointFor<M>* road, double, const Wheels<V>& wheel,
              V* unclipped, V* drag) {
  V deflection[kMaxAxles], rate[kMaxAxles];
  for (int i = 0; i < run.axles; ++i) {
    const TireLaw<V>& law = laws.tire[i];
    if (road[i].flat) {
      deflection[i] = law.static_deflection - wheel.rise[i];
      rate[i] = -wheel.rise_rate[i];
      continue;
    }
    const Squash<V> now = squash(road_rows(road[i]), law.static_deflection, wheel.advance[i], wheel.speed[i],
                                 wheel.rise[i], wheel.rise_rate[i]);
    drag[i] = now.drag;
    deflection[i] = now.deflection;
    rate[i] = now.rate;
  }
  for (int i = 0; i < run.axles; ++i) {
    const TireLaw<V>& law = laws.tire[i];
    unclipped[i] = tire_force(deflection[i], rate[i], law.inverse_reference, law.exponent, law.damping,
                              law.reference_load, law.growth);
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
                                   laws.reference_load[first / kLanes], laws.growth[first / kLanes]);
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
template <class V, class M>
inline V forward_speed(const Run<M>& run, const Laws<V>&, double time) {
  return constant_row<V>(run.motion.speed_at(time) - Pack{});
}
template <int T>
inline Jet<T> forward_speed(const Run<double>& run, const Laws<Jet<T>>& laws, double time) {
  const double tau = run.motion.since_start(time), now = run.motion.speed_at(time);
  if (now <= 0.0) return Jet<T>{};
  const MotionChange<Jet<T>>& change = laws.change;
  return now + (change.speed + tau * change.acceleration - run.motion.acceleration * change.start);
}

// ------------------------------------------------------------------------------------------------ the road under wheels

// The road under all wheels of a run, or of one in each lane.
template <class M>
class RoadUnderWheels {
 public:
  explicit RoadUnderWheels(const Run<M>& run) : run_(run), at_wheels_(run.axles) {
    for (int i = 0; i < run.axles; ++i) wheels_.emplace_back(run.road, i);
  }

  // The road where wheels are at the speed that is held; returns where one is not on flat road.
  Where<M> look_up(double time, PointFor<M>* at) {
    const M travelled = run_.motion.travelled(time);
    Where<M> felt{};
    for (int i = 0; i < run_.axles; ++i) felt |= wheels_[i].look_up(travelled - run_.axle_x[i], at[i]);
    return felt;
  }

  // The road where they are; what is left of their advance is its derivatives.
  template <class V>
  const PointFor<M>* at_wheels(const PointFor<M>* nominal, double time, Wheels<V>& wheel) {
    const M travelled = run_.motion.travelled(time);
    for (int i = 0; i < run_.axles; ++i) {
      if (nominal[i].flat) {
        at_wheels_[i].flat = true;
        continue;
      }
      const auto ahead = value(wheel.advance[i]);
      wheels_[i].look_up(travelled - run_.axle_x[i] + ahead, at_wheels_[i]);
      wheel.advance[i] = -ahead + wheel.advance[i];
    }
    return at_wheels_.data();
  }

 private:
  const Run<M>& run_;
  std::vector<RoadUnderWheel<M>> wheels_;
  std::vector<PointFor<M>> at_wheels_;
};

// -------------------------------------------------------------------------------------------------------------- forces

// What axles and frame feel of the springs' forces through rockers: S + s (mean S - S).
template <class V, class M>
inline void share(const Run<M>& run, const Laws<V>& laws, V* force) {
  V mean[kMaxAxles];
  transform(run.sharing, run.axles, force, mean);
  for (int i = 0; i < run.axles; ++i) force[i] += laws.suspension[i].load_share * (mean[i] - force[i]);
}

// Where in a step a stage stands, for states inside suspensions: time from its start, extension and rate there, and rates
// at both stages in the middle, null for these.
template <class V>
struct StageOfStep {
  double tau;
  bool whole;  // at the end of the step
  const BushingStart<V>* bushing;
  const V *extension, *rate, *second, *third;
  V bend(int i, const V& now) const {
    return second == nullptr ? V{} : 2.0 * (rate[i] + now - second[i] - third[i]);
  }
};

// Accelerations and forces in a state:
//   axles: m_u z'' = V - static load + pull,      bodies: b'' = A [pull; H] - M^-1 (tilt b + hold b'),
// and as in simulation.py where links lead wheels aft.
// `stage` is null at the start of a step, where the states inside suspensions are the step's own, `inner`; over edges
// `wheels` look the road up where they are.
template <class V, class M, int NB>
void forces(const Run<M>& run, const Laws<V>& laws, const PointFor<M>* road, RoadUnderWheels<M>& wheels, double time,
            const State<V, NB>& state, const Inner<V>& inner, const StageOfStep<V>* stage, Forces<V, NB>& out) {
  const int na = run.axles;
  const bool beams = run.beams.wheel != nullptr;
  if (run.rate_rows != nullptr)
    for (int j = 0; j < NB; ++j) out.body_rate[j] = state.body_rate[j];
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
  above_axles<NB>(run.position, na, state.body, state.axle, out.extension);
  above_axles<NB>(run.rate, na, state.body_rate, state.axle_rate, out.rate);
  for (int i = 0; i < na; ++i) {
    if (road[i].flat) continue;
    const M *along = run.position + (na + i) * NB, *along_rate = run.rate + (na + i) * NB;
    V advance{}, speed = nominal;
    for (int j = 0; j < NB; ++j) {
      accumulate(advance, along[j], state.body[j]);
      accumulate(speed, along_rate[j], state.body_rate[j]);
    }
    if (run.elements.trailing_links) {
      advance += laws.suspension[i].trailing * out.extension[i];
      speed += laws.suspension[i].trailing * out.rate[i];
    }
    wheel.advance[i] = advance;
    wheel.speed[i] = speed;
  }
  // Sets of one run differ from lane to lane: over edges they come as runs.
  if constexpr (!std::is_same_v<V, Pack> || std::is_same_v<M, Pack>)
    if (run.edged) road = wheels.at_wheels(road, time, wheel);
  contacts(run, laws, road, time, wheel, out.unclipped, drag);
  V body[NB]{};
  add_product<NB, NB>(run.position + 2 * na * NB, NB, state.body, body);
  add_product<NB, NB>(run.rate + 2 * na * NB, NB, state.body_rate, body);
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
  for (int i = 0; i < na; ++i) {
    const SuspensionLaw<V>& law = laws.suspension[i];
    if (linear) {
      out.pull[i] = law.stiffness * out.extension[i];
      continue;
    }
    out.pull[i] = spring_force(run.elements, law, out.extension[i]);
    if (!run.elements.friction) continue;
    if (stage == nullptr)
      out.pull[i] += law.friction * inner.slip[i];
    else
      out.pull[i] += law.friction * slip_at_stage(run.elements, law, inner.slip[i], stage->extension[i],
                                                  stage->rate[i], stage->tau, out.extension[i], out.rate[i]);
  }
  if (run.elements.equaliser) share(run, laws, out.pull);
  if (run.elements.damper_bushing && stage == nullptr)
    for (int i = 0; i < na; ++i) out.damper_rate[i] = inner.damper_rate[i];
  if (run.elements.damper_bushing && stage != nullptr)
    follow(run.elements, na, laws.suspension, stage->bushing, stage->whole, inner.damper_rate, stage->rate, stage->tau,
           out.damper_rate, [&](int i, V& linear, V& bend) {
             bend = stage->bend(i, out.rate[i]);
             linear = out.rate[i] - stage->rate[i] - bend;
           });
  for (int i = 0; i < na; ++i) {
    const SuspensionLaw<V>& law = laws.suspension[i];
    if (linear) {
      out.pull[i] += law.damping * out.rate[i];
      continue;
    }
    out.damper[i] = add_damper(run.elements, law, out.of_damper(run.elements, i), out.pull[i]);
    if (run.elements.stops > 0) out.pull[i] += ramp_force(law.stops, out.extension[i]);
  }
  for (int i = 0; i < na; ++i) {
    const SuspensionLaw<V>& law = laws.suspension[i];
    V pull = out.pull[i];
    if (beams) pull = run.beams.carries[i] * pull;
    const V vertical = positive(out.unclipped[i]);
    out.pull[i] = pull;
    out.axle[i] = -run.static_load[i] + vertical;
    if (road[i].flat) {
      out.horizontal[i] = V{};
    } else {
      out.horizontal[i] = drag[i] * vertical;
      if (run.elements.trailing_links) out.axle[i] += -(law.trailing * out.horizontal[i]);
      add_product<NB, 1>(run.acceleration + na + i, 2 * na, out.horizontal + i, body);
    }
    if (!beams) out.axle[i] = run.inverse_unsprung[i] * (out.axle[i] + pull);
  }
  if (beams) {
    V pushed[kMaxAxles], pulled[kMaxAxles];
    transform(run.beams.tire, na, out.axle, pushed);
    transform(run.beams.pull, na, out.pull, pulled);
    for (int i = 0; i < na; ++i) out.axle[i] = pushed[i] + pulled[i];
  }
  if (run.elements.trailing_links) {
    for (int i = 0; i < na; ++i) {
      const V& b = laws.suspension[i].trailing;
      out.axle[i] = out.axle[i] * reciprocal(1.0 + b * b);
      const V swinging = (1.0 / run.inverse_unsprung[i]) * (b * out.axle[i]);
      const V pull = -(b * (out.horizontal[i] + swinging));
      add_product<NB, 1>(run.acceleration + na + i, 2 * na, &swinging, body);
      add_product<NB, 1>(run.acceleration + i, 2 * na, &pull, body);
    }
  }
  add_product<NB>(run.acceleration, 2 * na, na, out.pull, body);
  for (int j = 0; j < NB; ++j) out.body[j] = body[j];
  if (run.elements.trailing_links) {
    for (int i = 0; i < na; ++i) {
      const V& b = laws.suspension[i].trailing;
      const M mass = 1.0 / run.inverse_unsprung[i];
      V above{}, along{};
      add_product<1>(run.position + i * NB, NB, NB, body, &above);
      add_product<1>(run.position + (na + i) * NB, NB, NB, body, &along);
      const V carried = b * (along + b * above) * reciprocal(1.0 + b * b);
      out.axle[i] += carried;
      const V further = mass * (b * (carried - above)), pull = b * (mass * along - further);
      add_product<NB, 1>(run.acceleration + na + i, 2 * na, &further, out.body);
      add_product<NB, 1>(run.acceleration + i, 2 * na, &pull, out.body);
    }
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
      for (int k = 0; k < 4; ++k) {
        extension[k] = stage[k].extension[i];
        rate[k] = stage[k].of_damper(run.elements, i);
      }
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

}  // namespace sysid
