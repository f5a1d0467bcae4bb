// Laws of suspension and tire on a tape, by their partial derivatives: each takes a few links, not one for every operation.

#pragma once

#include "integration.h"
#include "tape.h"

namespace sysid {

inline void plus(int n, const Taped* x, double a, const Taped* u, Taped* y) {
  Tape& tape = *x->tape;
  for (int k = 0; k < n; ++k) y[k] = tape.number(x[k].v + a * u[k].v);
  tape.sums<2>(n, {1.0, a}, {x, u}, y);
}
inline void plus(int n, const Taped* x, double a, const Taped* u, double b, const Taped* v, Taped* y) {
  Tape& tape = *x->tape;
  for (int k = 0; k < n; ++k) y[k] = tape.number(x[k].v + a * u[k].v + b * v[k].v);
  tape.sums<3>(n, {1.0, a, b}, {x, u, v}, y);
}
inline void advance(int n, double h, const Taped* a1, const Taped* a2, const Taped* a3, const Taped* a4, Taped* x,
                    Taped* v) {
  Tape& tape = *x->tape;
  Taped place[kMaxAxles], rate[kMaxAxles];
  for (int k = 0; k < n; ++k) {
    Pack at = x[k].v, now = v[k].v;
    advance(1, h, &a1[k].v, &a2[k].v, &a3[k].v, &a4[k].v, &at, &now);
    place[k] = tape.number(at);
    rate[k] = tape.number(now);
  }
  const double sixth = h / 6.0;
  tape.sums<5>(n, {1.0, h, h * sixth, h * sixth, h * sixth}, {x, v, a1, a2, a3}, place);
  tape.sums<5>(n, {1.0, sixth, 2.0 * sixth, 2.0 * sixth, sixth}, {v, a1, a2, a3, a4}, rate);
  for (int k = 0; k < n; ++k) x[k] = place[k], v[k] = rate[k];
}

// The tape of some numbers, null if all are constants.
inline Tape* tape_of(int n, const Taped* x) {
  for (int k = 0; k < n; ++k)
    if (x[k].tape != nullptr) return x[k].tape;
  return nullptr;
}

template <int rows, class M>
inline void add_product(const M* matrix, int stride, int columns, const Taped* x, Taped* y) {
  Tape* tape = tape_of(columns, x);
  for (int j = 0; j < rows; ++j) {
    Pack sum = y[j].v;
    for (int k = 0; k < columns; ++k) sum += matrix[j * stride + k] * x[k].v;
    if (y[j].tape == nullptr && tape != nullptr)
      y[j] = tape->number(sum);
    else
      y[j].v = sum;
  }
  if (tape != nullptr) tape->product(matrix, stride, rows, columns, x, y, nullptr);
}
template <int NB, class M>
inline void above_axles(const M* matrix, int axles, const Taped* body, const Taped* axle, Taped* y) {
  for (int i = 0; i < axles; ++i) {
    Pack above = -axle[i].v;
    for (int j = 0; j < NB; ++j) above += matrix[i * NB + j] * body[j].v;
    y[i] = axle->tape->number(above);
  }
  axle->tape->product(matrix, NB, axles, NB, body, y, axle);
}
template <class M>
inline void transform(const M* matrix, int n, const Taped* x, Taped* y) {
  Tape* tape = tape_of(n, x);
  for (int i = 0; i < n; ++i) {
    Pack sum{};
    for (int k = 0; k < n; ++k) sum += matrix[i * n + k] * x[k].v;
    y[i] = tape == nullptr ? constant_row<Taped>(sum) : tape->number(sum);
  }
  if (tape != nullptr) tape->product(matrix, n, n, n, x, y, nullptr);
}
template <class M>
inline Taped times_sum(const M& a, const Taped& b, const Taped& c) {
  const Pack factor = a - Pack{};
  return depends(factor * (b.v + c.v), b, factor, c, factor);
}

// Ramps that are touched in some lane.
inline void add_ramps(const std::vector<Ramp<Taped>>& ramps, const Taped& x, Taped& sum) {
  for (const Ramp<Taped>& ramp : ramps) {
    const Pack reach = ramp.side * (x.v - ramp.at.v);
    if (!any(reach > 0.0)) continue;
    const Pack slope = ramp.slope.v * where_positive(reach), by_slope = ramp.side * positive(reach);
    sum.v += ramp.slope.v * by_slope;
    sum.tape->link(sum, x, slope, ramp.at, -slope, ramp.slope, by_slope);
  }
}

inline Taped spring_force(const Elements& has, const SuspensionLaw<Taped>& law, const Taped& extension) {
  const Pack e = extension.v, k = law.stiffness.v;
  Taped force;
  if (has.gas_spring) {
    const Pack length = 1.0 + e * law.softening.v, square = e * e;
    const Mask shortest = length < kShortest;
    const Pack per_length = 1.0 / select(shortest, splat(kShortest), length), part = k * per_length;
    // e k / length, and its derivative by the length.
    const Pack by_length = select(shortest, Pack{}, -e * part * per_length);
    const Pack stiffened = e * (law.stiffening.v * square);
    force = extension.tape->depending(e * part + k * stiffened, extension,
                                      part + by_length * law.softening.v + 3.0 * k * law.stiffening.v * square,
                                      law.stiffness, e * per_length + stiffened, law.softening, by_length * e,
                                      law.stiffening, k * e * square);
  } else {
    force = law.stiffness * extension;
  }
  if (has.ramps > 0) add_ramps(law.ramps, extension, force);
  return force;
}

// c v times the damper's shape, and its derivatives.
struct DamperParts {
  Pack force, by_rate, by_scaled, by_saturation, by_rounding, by_tail;

  DamperParts(const SuspensionLaw<Taped>& law, const Pack& v) {
    const Pack size = absolute(v), relative = size * law.per_saturation.v;
    const Pack root = reciprocal_root(1.0 + relative * (2.0 * law.rounding.v + relative));
    const Pack shape = law.tail.v + law.falling.v * root, full = law.scaled.v * v;
    // The shape by the square under the root, and by |v| / v_s.
    const Pack by_square = -0.5 * law.falling.v * root * root * root;
    const Pack by_relative = by_square * 2.0 * (law.rounding.v + relative);
    force = full * shape;
    by_rate = law.scaled.v * (shape + relative * by_relative);
    by_scaled = v * shape;
    by_saturation = full * by_relative * size;
    by_rounding = full * by_square * 2.0 * relative;
    by_tail = full - full * root;  // what falls is 1 - tail
  }
};

inline Taped symmetric_again(const Elements& has, const SuspensionLaw<Taped>& law, const Taped& rate, const Taped&) {
  if (!has.saturating) return law.damping * rate;
  const DamperParts d(law, rate.v);
  return rate.tape->depending(d.force, rate, d.by_rate, law.scaled, d.by_scaled, law.per_saturation, d.by_saturation,
                              law.rounding, d.by_rounding, law.tail, d.by_tail);
}

// Returns a constant: few steps need the symmetric force once more.
inline Taped add_damper(const Elements& has, const SuspensionLaw<Taped>& law, const Taped& rate, Taped& pull) {
  const Mask out = rate.v >= 0.0;
  const Pack factor = has.asymmetric ? select(out, law.rebound.v, law.compression.v) : kOne;
  Pack symmetric;
  if (has.saturating) {
    const DamperParts d(law, rate.v);
    symmetric = d.force;
    pull.tape->link(pull, rate, factor * d.by_rate, law.scaled, factor * d.by_scaled, law.per_saturation,
                    factor * d.by_saturation, law.rounding, factor * d.by_rounding, law.tail, factor * d.by_tail);
  } else {
    symmetric = law.damping.v * rate.v;
    pull.tape->link(pull, rate, factor * law.damping.v, law.damping, factor * rate.v);
  }
  if (has.asymmetric && any(out)) pull.tape->link(pull, law.rebound, select(out, symmetric, Pack{}));
  if (has.asymmetric && any(~out)) pull.tape->link(pull, law.compression, select(out, Pack{}, symmetric));
  pull.v += symmetric * factor;
  if (has.rate_ramps > 0) add_ramps(law.rate_ramps, rate, pull);
  return constant_row<Taped>(symmetric);
}

// phi after a change in one direction, and its derivatives.
struct Slide {
  Pack phi, left, by_change, by_per_slip;

  Slide(const SuspensionLaw<Taped>& law, const Pack& before, const Pack& change) {
    const Pack sign = select(change == 0.0, Pack{}, sign_of(change)), size = absolute(change);
    left = exponential(-(size * law.per_slip.v));
    const Pack falling = (before - sign) * left;
    phi = sign + falling;
    by_change = -falling * law.per_slip.v * sign_of(change);
    by_per_slip = -falling * size;
  }
};

inline Taped slide(const SuspensionLaw<Taped>& law, const Taped& phi, const Taped& change) {
  const Slide s(law, phi.v, change.v);
  return change.tape->depending(s.phi, phi, s.left, change, s.by_change, law.per_slip, s.by_per_slip);
}

inline void add_friction(const SuspensionLaw<Taped>& law, const Taped& phi, const Taped& e0, const Taped& v0, double tau,
                         const Taped& e, Taped& pull) {
  if (any(turns_before<Pack>(e0.v, v0.v, tau, e.v))) {
    add_product(pull, law.friction, slip_at_stage(law, phi, e0, v0, tau, e));
    return;
  }
  const Slide s(law, phi.v, e.v - e0.v);
  const Pack force = law.friction.v, by_change = force * s.by_change;
  pull.v += force * s.phi;
  pull.tape->link(pull, law.friction, s.phi, phi, force * s.left, e, by_change, e0, -by_change, law.per_slip,
                  force * s.by_per_slip);
}

// The force of a tire, and its derivatives.
struct TireParts {
  Pack force, by_deflection, by_rate, by_inverse, by_exponent, by_damping;

  TireParts(const Pack& deflection, const Pack& rate, const Pack& inverse, const Pack& exponent, const Pack& damping,
            const Pack& reference_load, double growth) {
    const Pack relative = deflection * inverse, size = absolute(relative), side = sign_of(relative);
    const Mask none = !(size > kNoDeflection), pressed = relative >= 0.0;
    const Pack sign = select(none, Pack{}, side);
    const Pack binary = binary_logarithm(select(none, kOne, size));
    const Pack elastic = reference_load * sign * power_of_two(exponent * binary);
    const Pack root = reciprocal_root(size + kSoftDamping), soft = std::sqrt(1.0 + kSoftDamping) * root;
    const Pack length = soft * size, counted = select(pressed, rate, -absolute(rate));
    const Pack by_length = damping * growth * counted;
    const Pack by_relative = elastic * exponent / select(none, kOne, relative) +
                             side * by_length * soft * (1.0 - 0.5 * size * root * root);
    by_damping = rate + growth * (counted * length - rate);
    force = elastic + damping * by_damping;
    by_deflection = by_relative * inverse;
    by_rate = damping * ((1.0 - growth) + growth * length * select(pressed, kOne, -sign_of(rate)));
    by_inverse = by_relative * deflection;
    by_exponent = elastic * (binary * 0.6931471805599453);
  }
};

inline Taped tire_force(const Taped& deflection, const Taped& rate, const Taped& inverse, const Taped& exponent,
                        const Taped& damping, Pack reference_load, double growth) {
  const TireParts t(deflection.v, rate.v, inverse.v, exponent.v, damping.v, reference_load, growth);
  return deflection.tape->depending(t.force, deflection, t.by_deflection, rate, t.by_rate, inverse, t.by_inverse,
                                    exponent, t.by_exponent, damping, t.by_damping);
}
inline Taped force_on_flat(const TireLaw<Taped>& law, const Taped& rise, const Taped& rise_rate, double growth) {
  const TireParts t(law.static_deflection.v - rise.v, -rise_rate.v, law.inverse_reference.v, law.exponent.v,
                    law.damping.v, law.reference_load, growth);
  return rise.tape->depending(t.force, law.static_deflection, t.by_deflection, rise, -t.by_deflection, rise_rate,
                              -t.by_rate, law.inverse_reference, t.by_inverse, law.exponent, t.by_exponent, law.damping,
                              t.by_damping);
}

// The tire on the bump: partial derivatives beside the values.
template <class Q>
inline Squash<Taped> squash(const RoadRows<Q>& road, const Taped& u0, const Taped& advance, const Taped& speed,
                            const Taped& rise, const Taped& rise_rate) {
  constexpr int n = 5;
  const Squash<Local<n>> found = squash(road, variable<n>(u0.v, 0), variable<n>(advance.v, 1), variable<n>(speed.v, 2),
                                        variable<n>(rise.v, 3), variable<n>(rise_rate.v, 4));
  const auto link = [&](const Local<n>& x) {
    return u0.tape->depending(x.v, u0, x.d[0], advance, x.d[1], speed, x.d[2], rise, x.d[3], rise_rate, x.d[4]);
  };
  return {link(found.deflection), link(found.rate), link(found.drag)};
}

// What the stages miss of a clipped quantity; see `missed_by_stages` of packs.
inline bool missed_by_stages(const Taped& p1, const Taped& p2, const Taped& p3, const Taped& p4, Taped& impulse,
                             Taped& moment) {
  const Mask where = changes_sign(p1.v, p2.v, p3.v, p4.v);
  if (!any(where)) return false;
  Local<3> whole, first;
  clipped_integrals(variable<3>(p1.v, 0), variable<3>(0.5 * (p2.v + p3.v), 1), variable<3>(p4.v, 2), whole, first);
  const auto link = [&](const Local<3>& x, double b1, double b2, double b4) {
    const auto by = [&](const Pack& integral, double share, const Taped& p) {
      return select(where, integral - share * where_positive(p.v), Pack{});
    };
    const Pack stages = b1 * positive(p1.v) + b2 * (positive(p2.v) + positive(p3.v)) + b4 * positive(p4.v);
    Tape* tape = p1.tape;
    return tape->depending(select(where, x.v - stages, Pack{}), p1, by(x.d[0], b1, p1), p2, by(0.5 * x.d[1], b2, p2), p3,
                           by(0.5 * x.d[1], b2, p3), p4, by(x.d[2], b4, p4));
  };
  impulse = link(whole, 1.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0);
  moment = link(first, 1.0 / 6.0, 1.0 / 6.0, 0.0);
  return true;
}

}  // namespace sysid
