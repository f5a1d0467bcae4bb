// Suspension laws: the equations of sysid/vehicle_model/suspension.py, one axle at a time.

#pragma once

#include <vector>

#include "contact.h"

namespace sysid {

// side * slope * max(0, side (x - at)) of a piecewise linear curve.
template <class V>
struct Ramp {
  V at, slope;
  Scalar<V> side;
};

// Which elements a group of runs has: what none of its axles needs is not computed.
struct Elements : SmoothElements {
  int ramps = 0, stops = 0, rate_ramps = 0;
  bool corners() const { return saturating || asymmetric || ramps > 0 || stops > 0 || rate_ramps > 0; }
  bool linear() const {
    SmoothElements forces = *this;
    forces.trailing_links = false;  // they lead the wheel, beside any law
    return !forces.any() && !corners();
  }
};

// pull = S(e) + F_c phi + D(u) + stops(e), positive when it pulls body and axle together; e extension from rest, u the
// rate of the damper, which in bushings is less than that of the extension.
template <class V>
struct SuspensionLaw {
  V stiffness, damping;                // k [N/m], c [N s/m]
  V softening, stiffening;             // 1/l [1/m], 1/d^2 [1/m2]
  V per_saturation, rounding, tail;    // 1/v_s [s/m], b, r
  V falling, scaled, curvature;        // 1 - r; c over the shape at the reference rate; D ~ curvature v |v| near rest
  V rebound, compression, corner;      // 2 q / (1 + q), 2 / (1 + q), and their difference
  V common_curvature;                  // what both directions have of the curvature
  V friction, per_slip;                // F_c [N], 1/z_s [1/m]
  V friction_growth;                   // g [1/m] of friction that follows the load on the leaves
  V sliding, sticking;                 // r, 1 - r
  V per_sliding_rate;                  // 1/v_s [s/m]
  V load_share;                        // s of a rocker between springs
  V compliance;                        // 1/k_b of a damper's bushings [m/N]
  V trailing;                          // b: how far the wheel goes aft over its jounce
  std::vector<Ramp<V>> ramps, stops, rate_ramps;
};

template <class V>
inline V ramp_force(const std::vector<Ramp<V>>& ramps, const V& x) {
  V sum{};
  for (const Ramp<V>& ramp : ramps) sum += ramp.side * (ramp.slope * positive(ramp.side * (x - ramp.at)));
  return sum;
}

// S = k e (1 / max(1 + e / l, 0.05) + (e / d)^2): the isothermal law of a gas spring, and a bellows that widens.
template <class V>
inline V spring_force(const Elements& has, const SuspensionLaw<V>& law, const V& extension) {
  V force = law.stiffness * extension;
  if (has.gas_spring) {
    const V length = 1.0 + extension * law.softening;
    const V shortest = constant_row<V>(kShortest - Scalar<V>{});
    force = force / select(value(length) < kShortest, shortest, length) +
            law.stiffness * extension * (law.stiffening * (extension * extension));
  }
  if (has.ramps > 0) force += ramp_force(law.ramps, extension);
  return force;
}

// r + (1 - r) / sqrt(1 + 2 b |v| / v_s + (v / v_s)^2)
template <class V>
inline V damper_shape(const SuspensionLaw<V>& law, const V& rate) {
  const V relative = absolute(rate) * law.per_saturation;
  return law.tail + law.falling * reciprocal_root(1.0 + relative * (2.0 * law.rounding + relative));
}

// c v, or c v times the damper's shape over what that is at the reference rate.
template <class V>
inline V symmetric_damper(const Elements& has, const SuspensionLaw<V>& law, const V& rate) {
  return has.saturating ? law.scaled * rate * damper_shape(law, rate) : law.damping * rate;
}

// D(v) from that of the symmetric damper.
template <class V>
inline V damper_force(const Elements& has, const SuspensionLaw<V>& law, const V& rate, const V& symmetric) {
  V force = symmetric;
  if (has.asymmetric) force = force * select(value(rate) >= 0.0, law.rebound, law.compression);
  if (has.rate_ramps > 0) force += ramp_force(law.rate_ramps, rate);
  return force;
}

// Adds D(v) to a pull; returns the force of the symmetric damper.
template <class V>
inline V add_damper(const Elements& has, const SuspensionLaw<V>& law, const V& rate, V& pull) {
  const V symmetric = symmetric_damper(has, law, rate);
  pull += damper_force(has, law, rate, symmetric);
  return symmetric;
}

// Slope dD/dv of a damper at its rate; at a corner, that of higher rates.
template <class V>
inline V damper_slope(const Elements& has, const SuspensionLaw<V>& law, const V& rate) {
  V slope = law.damping;
  if (has.saturating) {
    // d/dv of v / sqrt(g), g = 1 + 2 b x + x^2 and x = |v| / v_s, is (1 + b x) / g^1.5.
    const V relative = absolute(rate) * law.per_saturation;
    const V root = reciprocal_root(1.0 + relative * (2.0 * law.rounding + relative));
    slope = law.scaled * (law.tail + law.falling * (1.0 + law.rounding * relative) * (root * root * root));
  }
  if (has.asymmetric) slope = slope * select(value(rate) >= 0.0, law.rebound, law.compression);
  if (has.rate_ramps > 0)
    for (const Ramp<V>& ramp : law.rate_ramps)
      slope += select(ramp.side * (value(rate) - value(ramp.at)) > 0.0, ramp.slope, V{});
  return slope;
}

// e^(-1 / lag): what is left of a difference after a time over which a damper in bushings lags by `lag`.
template <class V>
inline V left_after(const V& lag) {
  const V shortest = constant_row<V>(1.0 / kLongest - Scalar<V>{});
  return exponential(-reciprocal(select(value(lag) > 1.0 / kLongest, lag, shortest)));
}

// u(1) of lag u' = v + linear s + bend s^2 - u from u(0): the part that follows v, and its remainder.
template <class V>
inline V relaxed(const V& lag, const V& left, const V& u, const V& v, const V& linear, const V& bend) {
  const V curved = lag * (2.0 * bend);
  const V started = v - lag * (linear - curved);
  return v + linear + bend - lag * (linear + 2.0 * bend - curved) + (u - started) * left;
}

// What the stages of a step have in common for a damper in bushings: slope and force of its curve where the step begins,
// and its lag over half the step and over all of it.
template <class V>
struct BushingStart {
  V steep, here, lag[2], left[2];
};

template <class V>
inline void begin_bushing(const Elements& has, const SuspensionLaw<V>& law, const V& u, double half, double whole,
                          BushingStart<V>& start) {
  start.steep = damper_slope(has, law, u);
  start.here = damper_force(has, law, u, symmetric_damper(has, law, u));
  for (int k = 0; k < 2; ++k) {
    start.lag[k] = (1.0 / (k == 0 ? half : whole)) * law.compliance * start.steep;
    start.left[k] = left_after(start.lag[k]);
  }
}

// Rates of n dampers in bushings after `tau`, half a step or a `whole` one, along the suspension's rates v + linear s +
// bend s^2, s from 0 to 1, of which path(axle, linear, bend) tells the coefficients: with the slope of their curve where
// the step begins, and then with the chord from there to where that leads. The force changes by the chord times the change
// of u; u is the rate on the curve at that force, by one step of Newton.  Every operation is done for all axles before the
// next one: processors overlap them, while those of one axle wait for each other.
template <class V, class Path>
inline void follow(const Elements& has, int n, const std::vector<SuspensionLaw<V>>& law, const BushingStart<V>* start,
                   bool whole, const V* u, const V* v, double tau, V* found, Path&& path) {
  const V one = constant_row<V>(Scalar<V>{} + 1.0);
  V linear[kMaxAxles], bend[kMaxAxles], slope[kMaxAxles], left[kMaxAxles];
  for (int i = 0; i < n; ++i) path(i, linear[i], bend[i]);
  for (int i = 0; i < n; ++i)
    found[i] = relaxed(start[i].lag[whole], start[i].left[whole], u[i], v[i], linear[i], bend[i]);
  if (!has.saturating && !has.asymmetric && has.rate_ramps == 0) return;
  for (int i = 0; i < n; ++i) {
    const V change = found[i] - u[i];
    const auto moves = absolute(value(change)) > kSmallChange;
    const V there = damper_force(has, law[i], found[i], symmetric_damper(has, law[i], found[i]));
    slope[i] = select(moves, (there - start[i].here) / select(moves, change, one), start[i].steep);
  }
  for (int i = 0; i < n; ++i) left[i] = left_after((1.0 / tau) * law[i].compliance * slope[i]);
  for (int i = 0; i < n; ++i)
    found[i] = relaxed((1.0 / tau) * law[i].compliance * slope[i], left[i], u[i], v[i], linear[i], bend[i]);
  for (int i = 0; i < n; ++i) {
    const V missed = start[i].here + slope[i] * (found[i] - u[i]) -
                     damper_force(has, law[i], found[i], symmetric_damper(has, law[i], found[i]));
    found[i] += missed / damper_slope(has, law[i], found[i]);
  }
}

// w(e, v) of leaf packs: friction that they reach in the end, over that at rest.
template <class V>
inline V envelope(const SuspensionLaw<V>& law, const V& e, const V& v) {
  const V relative = v * law.per_sliding_rate;
  return positive(1.0 + -(law.friction_growth * e)) * (law.sliding + law.sticking * reciprocal(1.0 + relative * relative));
}

// phi after the extension changes in one direction (Dahl): s w + (phi - s w) exp(-|change| / z_s), s = sgn(change).
template <class V>
inline V slide(const Elements& has, const SuspensionLaw<V>& law, const V& phi, const V& change, const V& w) {
  const Scalar<V> sign = select(value(change) == 0.0, Scalar<V>{}, sign_of(value(change)));
  const V end = has.leaf_friction ? sign * w : constant_row<V>(sign);
  return end + (phi - end) * exponential(-(absolute(change) * law.per_slip));
}

// phi after the extension goes from e0 to where it turns, and on to e; without turns, straight there.
template <class V, class Mask>
inline V slide_and_back(const Elements& has, const SuspensionLaw<V>& law, const V& phi, const V& e0, const V& v0,
                        const V& turned, const Mask& turns, const V& e, const V& v) {
  V before{}, after{};
  if (has.leaf_friction) {
    const V start = envelope(law, e0, v0);
    const V between = any(turns) ? select(turns, envelope(law, turned, V{}), start) : start;
    before = 0.5 * (start + between);
    after = 0.5 * (between + envelope(law, e, v));
  }
  if (!any(turns)) return slide(has, law, phi, e - e0, after);
  return slide(has, law, slide(has, law, phi, turned - e0, before), e - turned, after);
}

// phi at a stage `tau` into the step, from the parabola through the step's start (extension e0, rate v0) and the
// stage's extension e, its rate v: where it turns in between the element slides to the turning point and back.
template <class V>
inline V slip_at_stage(const Elements& has, const SuspensionLaw<V>& law, const V& phi, const V& e0, const V& v0,
                       double tau, const V& e, const V& v) {
  const Scalar<V> straight = tau * value(v0);
  const auto turns = value(v0) * (straight + 2.0 * (value(e) - value(e0) - straight)) < 0.0;
  if (!any(turns)) return slide_and_back(has, law, phi, e0, v0, e0, turns, e, v);
  const V reach = tau * v0, bend = e - e0 - reach;
  const V one = constant_row<V>(Scalar<V>{} + 1.0);
  const V turned = e0 - select(turns, reach * reach, V{}) / (4.0 * select(turns, bend, one));
  return slide_and_back(has, law, phi, e0, v0, turned, turns, e, v);
}

// Root in [0, 1] of the rate v0 + b s + a s^2 of the cubic between both ends of a step of unit length.
template <class S>
inline S turning_point(S change, S v0, S v1) {
  const S a = 3.0 * (v0 + v1) - 6.0 * change, b = 6.0 * change - 4.0 * v0 - 2.0 * v1;
  const S half = -0.5 * (b + sign_of(b) * square_root(positive(b * b - 4.0 * a * v0)));
  const S none = S{} - 1.0;
  const S first = select(a != 0.0, half / a, none), second = select(half != 0.0, v0 / half, none);
  return at_most_one(positive(select((second >= 0.0) & (second <= 1.0), second, first)));
}

// phi at the end of a step, through the turning point of the cubic between extension and rate at both ends; the rate
// vanishes there, so the exact derivative needs no derivative of its place.
template <class V>
inline V slip_after_step(const Elements& has, const SuspensionLaw<V>& law, const V& phi, const V& e0, const V& v0,
                         const V& e1, const V& v1, double h) {
  const auto turns = value(v0) * value(v1) < 0.0;
  const V change = e1 - e0;
  if (!any(turns)) return slide_and_back(has, law, phi, e0, v0, e0, turns, e1, v1);
  const Scalar<V> s = turning_point(value(change), h * value(v0), h * value(v1)), rest = 1.0 - s;
  const V cubic = e0 + s * ((h * rest * rest) * v0 + s * ((3.0 - 2.0 * s) * change - (h * rest) * v1));
  return slide_and_back(has, law, phi, e0, v0, V(select(turns, cubic, e0)), turns, e1, v1);
}

// The law of an axle, without its ramps.
template <class V>
inline SuspensionLaw<V> suspension_law(const Elements& has, const Coefficients<V>& c) {
  SuspensionLaw<V> law{};
  law.stiffness = c.stiffness;
  law.damping = c.damping;
  law.softening = c.softening;
  law.stiffening = c.stiffening;
  if (has.saturating) {
    law.per_saturation = reciprocal(c.saturation);
    law.rounding = c.rounding;
    law.tail = c.tail;
    law.falling = 1.0 + -law.tail;
    law.scaled = law.damping / damper_shape(law, constant_row<V>(Scalar<V>{} + kReferenceRate));
    law.curvature = -law.falling * law.rounding * law.scaled * law.per_saturation;
  }
  if (has.asymmetric) {
    law.compression = 2.0 * reciprocal(1.0 + c.asymmetry);
    law.rebound = c.asymmetry * law.compression;
    law.corner = law.rebound - law.compression;
  }
  if (has.saturating) law.common_curvature = has.asymmetric ? law.compression * law.curvature : law.curvature;
  law.friction = c.friction;
  law.per_slip = reciprocal(c.slip);
  if (has.leaf_friction) {
    law.friction_growth = c.friction_growth;
    law.sliding = c.sliding;
    law.sticking = 1.0 + -law.sliding;
    law.per_sliding_rate = reciprocal(c.sliding_rate);
  }
  law.load_share = c.load_share;
  law.compliance = c.compliance;
  law.trailing = c.trailing;
  return law;
}

// Mean force over a step, and its first moment, that the stages miss; `found` if they miss anything.
template <class V>
struct MissedForce {
  V impulse{}, moment{};
  bool found = false;

  void add(const V (&p)[4], const V& factor) {
    V mean, first;
    if (!missed_by_stages(p[0], p[1], p[2], p[3], mean, first)) return;
    impulse += factor * mean;
    moment += factor * first;
    found = true;
  }
  // Of factor v |v| where v changes sign along the straight line from a to b: the curvature of a rounded damper.
  void add_curvature(const V& a, const V& b, const V& factor) {
    const auto turns = value(a) * value(b) < 0.0;
    if (!any(turns)) return;
    const V one = constant_row<V>(Scalar<V>{} + 1.0), first = select(turns, a, V{}), last = select(turns, b, one);
    const V middle = 0.5 * (first + last), change = last - first;
    const V before = absolute(first) * first, between = absolute(middle) * middle, after = absolute(last) * last;
    const V cubes = (absolute(after) * absolute(last) - absolute(before) * absolute(first)) / (3.0 * change);
    const V fourth = (after * absolute(after) - before * absolute(before)) / (4.0 * change);
    impulse += factor * select(turns, cubes - (1.0 / 6.0) * (before + 4.0 * between + after), V{});
    moment += factor * select(turns, (last * cubes - fourth) / change - (1.0 / 6.0) * (before + 2.0 * between), V{});
    found = true;
  }
  void add(const std::vector<Ramp<V>>& ramps, const V (&x)[4]) {
    for (const Ramp<V>& ramp : ramps) {
      V p[4];
      for (int k = 0; k < 4; ++k) p[k] = ramp.side * (x[k] - ramp.at);
      add(p, ramp.side * ramp.slope);
    }
  }
};

// What the stages miss at the corners of a law beside its spring: stops and damper, whose rate and symmetric part
// `damper` have been found by the stages.
template <class V>
inline void add_missed(const Elements& has, const SuspensionLaw<V>& law, const V (&extension)[4], const V (&rate)[4],
                       const V (&damper)[4], MissedForce<V>& missed) {
  missed.add(law.stops, extension);
  missed.add(law.rate_ramps, rate);
  if (has.saturating) missed.add_curvature(rate[0], rate[3], law.common_curvature);
  if (has.asymmetric) {
    // D = (2 / (1 + q)) (d(v) + (q - 1) max(d(v), 0)): the second part has a corner.
    V p[4];
    for (int k = 0; k < 4; ++k) {
      // The parabola goes on as d(v) does for v > 0.
      const V below = positive(-rate[k]);
      p[k] = has.saturating ? damper[k] + 2.0 * law.curvature * below * below : damper[k];
    }
    missed.add(p, law.corner);
  }
}

}  // namespace sysid
