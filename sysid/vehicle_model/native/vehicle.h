// The planar vehicle over a bump: the equations of sysid/vehicle_model/simulation.py, contact.py, kink.py and filters.py.
//
// A run is integrated for one "row" V of numbers at a time, and V is one of
//   Pack    one number for each of several parameter sets;
//   Jet<T>  one number and its derivatives: lane 0 is the value, the other lanes are its derivatives with respect to
//           the unknowns, so that linear operations treat all lanes alike.
// Where an equation is not linear, Jet<T> takes the partial derivatives of it from Local<N> numbers, whose lanes are the
// axles, so that each equation stands here once.

#pragma once

#include <vector>

#include "pack.h"

namespace sysid {

constexpr int kMaxAxles = 24;
constexpr double kSoftDamping = 0.1;
constexpr int kMapRows = 8;  // rise, alpha_1, alpha_2, alpha_3, lift, beta_0, beta_1, beta_2
constexpr int kOrders = 5;   // value and four derivatives along the road

// ---------------------------------------------------------------------------------------------------- rows of numbers

template <int T>
struct Jet {
  Pack d[T];
};

inline Pack first_lane(double x) {
  Pack p = Pack{};
  p[0] = x;
  return p;
}

template <int T>
inline Jet<T> operator+(const Jet<T>& a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a.d[t] + b.d[t];
  return y;
}
template <int T>
inline Jet<T> operator-(const Jet<T>& a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a.d[t] - b.d[t];
  return y;
}
template <int T>
inline Jet<T> operator*(double a, const Jet<T>& b) {
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = a * b.d[t];
  return y;
}
template <int T>
inline Jet<T>& operator+=(Jet<T>& a, const Jet<T>& b) {
  for (int t = 0; t < T; ++t) a.d[t] += b.d[t];
  return a;
}

template <class V>
struct Row;  // what V is made of

template <>
struct Row<Pack> {
  static constexpr int packs = 1;
  static Pack* at(Pack& x) { return &x; }
};
template <int T>
struct Row<Jet<T>> {
  static constexpr int packs = T;
  static Pack* at(Jet<T>& x) { return x.d; }
};

// x + c for a constant c.
inline Pack plus(const Pack& x, double c) { return x + c; }
template <int T>
inline Jet<T> plus(Jet<T> x, double c) {
  x.d[0] += first_lane(c);
  return x;
}

template <class V>
inline V zero() {
  return V{};
}

inline Pack product(const Pack& a, const Pack& b) { return a * b; }
// (ab)' = a b' + b a'
template <int T>
inline Jet<T> product(const Jet<T>& a, const Jet<T>& b) {
  const double av = a.d[0][0], bv = b.d[0][0];
  Jet<T> y;
  for (int t = 0; t < T; ++t) y.d[t] = av * b.d[t] + bv * a.d[t];
  y.d[0] -= first_lane(av * bv);
  return y;
}

inline Pack reciprocal(const Pack& a) { return 1.0 / a; }
// (1/a)' = -a'/a^2
template <int T>
inline Jet<T> reciprocal(const Jet<T>& a) {
  const double inverse = 1.0 / a.d[0][0];
  return plus(-inverse * inverse * a, 2.0 * inverse);
}

template <int T>
inline Jet<T> positive(const Jet<T>& x) {
  return x.d[0][0] <= 0.0 ? Jet<T>{} : x;
}

// x where the sign of `side` times it is negative, else 0.
inline Pack beyond(const Pack& x, double side) { return select(side * x < 0.0, x, Pack{}); }
template <int T>
inline Jet<T> beyond(const Jet<T>& x, double side) {
  return side * x.d[0][0] < 0.0 ? x : Jet<T>{};
}

// ---------------------------------------------------------------------------------------------------------- the road

// Eight rows of a map at one position: they are looked up together.
typedef double MapRow __attribute__((vector_size(kMapRows * 8)));

// Quintic B-spline coefficients of one run: rise (na, n), stretch (4, na, n), drag (3, na, n), rows `stride` apart.
struct RoadTable {
  const double* rise;
  const double* stretch;  // null: a point follower
  const double* drag;
  int64_t stations, stretch_stride, drag_stride;
  double first_station, step;
  const double* polynomial;  // (6, 6) from the coefficients around a cell to powers of the position in it
};

// The road under one wheel: order[k] is the k-th derivative along the road of the eight rows.
struct RoadPoint {
  MapRow order[kOrders];
  bool flat;
};

// Looks the road up under one wheel; remembers the cell it was in.
class WheelRoad {
 public:
  WheelRoad(const RoadTable& table, int axle) : table_(table), axle_(axle) {}

  void look_up(double position, RoadPoint& point) {
    const double last = static_cast<double>(table_.stations) - 4.0;
    double scaled = (position - table_.first_station) / table_.step;
    scaled = scaled < 2.0 ? 2.0 : (scaled > last ? last : scaled);
    const int64_t cell = static_cast<int64_t>(scaled);
    if (cell != cell_) enter(cell);
    point.flat = flat_;
    if (flat_) return;
    const double t = scaled - static_cast<double>(cell);
    static constexpr double kFactor[kOrders][6] = {
        {1, 1, 1, 1, 1, 1}, {1, 2, 3, 4, 5, 0}, {2, 6, 12, 20, 0, 0}, {6, 24, 60, 0, 0, 0}, {24, 120, 0, 0, 0, 0}};
    double scale = 1.0;
    for (int order = 0; order < kOrders; ++order) {
      MapRow found = kFactor[order][5 - order] * term_[5];
      for (int power = 4; power >= order; --power) found = found * t + kFactor[order][power - order] * term_[power];
      point.order[order] = found * scale;
      scale /= table_.step;
    }
  }

 private:
  // Polynomials of the cell; it is flat where no coefficient can be felt (outside the bump they are zero).
  void enter(int64_t cell) {
    MapRow weight[6];
    bool nothing = true;
    for (int k = 0; k < 6; ++k) {
      const int64_t at = axle_ * table_.stations + cell - 2 + k;
      MapRow w = {};
      w[0] = table_.rise[at];
      if (table_.stretch != nullptr) {
        for (int row = 0; row < 4; ++row) w[1 + row] = table_.stretch[row * table_.stretch_stride + at];
        for (int row = 0; row < 3; ++row) w[5 + row] = table_.drag[row * table_.drag_stride + at];
      }
      for (int row = 0; row < kMapRows; ++row) nothing = nothing && std::abs(w[row]) < 1e-22;
      weight[k] = w;
    }
    cell_ = cell;
    flat_ = nothing;
    for (int power = 0; power < 6; ++power) {
      term_[power] = MapRow{};
      for (int k = 0; k < 6; ++k) term_[power] += table_.polynomial[6 * power + k] * weight[k];
    }
  }

  const RoadTable& table_;
  int64_t axle_;
  int64_t cell_ = -1;
  bool flat_ = true;
  MapRow term_[6];
};

// --------------------------------------------------------------------------------------------------- tire and contact

// Laws of one axle: suspension k [N/m], c [N s/m]; tire u_0 [m], 1/u_ref [1/m], n [-], c_t [N s/m], F_ref [N].
template <class V>
struct AxleLaw {
  V stiffness, damping;
  V static_deflection, inverse_reference, exponent, tire_damping;
  double reference_load;
};

template <class T>
struct Squash {
  T deflection, rate, drag;
};

// Rows of the road and their derivatives as numbers of type Q (`lift` is where the undeformed wheel first touches).
template <class Q>
struct RoadRows {
  Q rise, slope, second, third;
  Q stretch[4][3];  // alpha_1, alpha_2, alpha_3, lift: value, first and second derivative
  Q drag[3][3];     // beta_0, beta_1, beta_2
};

// a(s + advance) and its slope there, by Taylor's theorem.
template <class T, class Q>
inline T moved(const Q (&a)[3], const T& advance) {
  return advance * (a[1] + 0.5 * (advance * a[2])) + a[0];
}
template <class T, class Q>
inline T moved_slope(const Q (&a)[3], const T& advance) {
  return advance * a[2] + a[1];
}

// Equivalent deflection e of the footprint, its rate, and H/V:
//   v = W(s) - z,  w = max(v, lift(s) - u_0),  e = u_0 + v + alpha_1 w + alpha_2 w^2 + alpha_3 w^3,
//   H/V = beta_0 + beta_1 w + beta_2 w^2,   all rows at s + advance.
template <class T, class Q>
inline Squash<T> squash(const RoadRows<Q>& road, const T& u0, const T& advance, const T& speed, const T& rise,
                        const T& rise_rate) {
  const T slope = advance * (road.second + 0.5 * (advance * road.third)) + road.slope;
  const T height =
      advance * (road.slope + advance * (0.5 * road.second + (1.0 / 6.0) * (advance * road.third))) + road.rise;
  const T below = height - rise;
  const T below_rate = slope * speed - rise_rate;
  const T a = moved(road.stretch[0], advance), b = moved(road.stretch[1], advance), c = moved(road.stretch[2], advance);
  const T da = moved_slope(road.stretch[0], advance), db = moved_slope(road.stretch[1], advance),
          dc = moved_slope(road.stretch[2], advance);
  const T lowest = moved(road.stretch[3], advance) - u0;
  const Mask touching = value(below) > value(lowest);
  const T w = select(touching, below, lowest);
  const T w_rate = select(touching, below_rate, speed * moved_slope(road.stretch[3], advance));
  Squash<T> found;
  found.deflection = (u0 + below) + w * (a + w * (b + w * c));
  found.rate = (below_rate + w_rate * (a + w * (2.0 * b + 3.0 * (w * c)))) + speed * (w * (da + w * (db + w * dc)));
  found.drag =
      moved(road.drag[0], advance) + w * (moved(road.drag[1], advance) + w * moved(road.drag[2], advance));
  return found;
}

// Unclipped vertical force F_ref sign(x) |x|^n + c g de/dt with x = e / u_ref and the growth of damping with the length
// of the contact, g = |x| sqrt((1 + 0.1) / (|x| + 0.1)); off the ground the rate counts as -|de/dt|.
template <class T>
inline T tire_force(const T& deflection, const T& rate, const T& inverse_reference, const T& exponent, const T& damping,
                    Pack reference_load, double growth) {
  const T relative = deflection * inverse_reference;
  const T size = absolute(relative);
  const Pack sign = select(value(size) > 1e-12, sign_of(value(relative)), Pack{});
  const T elastic = (reference_load * sign) * exponential(exponent * logarithm(size));
  const T length = (std::sqrt(1.0 + kSoftDamping) * size) / square_root(size + splat(kSoftDamping));
  const T grown = select(value(relative) >= 0.0, rate, -absolute(rate)) * length;
  return elastic + damping * (rate + growth * (grown - rate));
}

// ------------------------------------------------------------------------------------------- clipped force over a step

// Integrals over the unit step of max(0, q) and (1 - s) max(0, q), for the quadratic q(s) = p_0 + b s + a s^2 through the
// values p_0, p_m, p_1 at its start, middle and end.  The step is cut at the roots of q, where it does not change sign,
// so that each part adds max(0, its integral); as q vanishes there, derivatives need no derivative of the root.
template <class T>
inline void clipped_integrals(const T& p0, const T& pm, const T& p1, T& impulse, T& moment) {
  const T a = 2.0 * (p0 - 2.0 * pm + p1);
  const T b = 4.0 * pm - 3.0 * p0 - p1;
  const Pack av = value(a), bv = value(b), cv = value(p0);
  const Pack discriminant = bv * bv - 4.0 * av * cv;
  const Pack half = -0.5 * (bv + sign_of(bv) * square_root(positive(discriminant)));
  const Mask none = discriminant <= 0.0;
  Pack first = select(av != 0.0, half / av, Pack{}), second = select(half != 0.0, cv / half, Pack{});
  first = at_most_one(positive(select(none, Pack{}, first)));
  second = at_most_one(positive(select(none, Pack{}, second)));
  const Mask ordered = first < second;
  const Pack low = select(ordered, first, second), high = select(ordered, second, first);
  const auto plain = [&](Pack s) { return s * (p0 + s * (0.5 * b + s * ((1.0 / 3.0) * a))); };
  const auto weighted = [&](Pack s) {
    return s * (p0 + s * (0.5 * (b - p0) + s * ((1.0 / 3.0) * (a - b) - s * (0.25 * a))));
  };
  const auto parts = [&](const T& at_low, const T& at_high, const T& at_end) {
    return positive(at_low) + positive(at_high - at_low) + positive(at_end - at_high);
  };
  impulse = parts(plain(low), plain(high), plain(splat(1.0)));
  moment = parts(weighted(low), weighted(high), weighted(splat(1.0)));
}

// ------------------------------------------------------------------------------------------------------------- one run

// Constants of one run (matrices as in LaneMatrices): na axles, nb body coordinates, nr body sensors.
struct Run {
  int axles, body_sensors;
  const double *position, *rate, *acceleration, *inverse_unsprung, *static_load, *body_rows, *axle_x;
  RoadTable road;
  double speed, start, growth;
};

// Forward speed of a run and how far it is ahead of where the road is looked up, ahead = ahead_rate (t - start) + ahead_0.
template <class V>
struct Travel {
  V speed, ahead_rate, ahead_start;
};

template <class V>
struct Laws {
  std::vector<AxleLaw<V>> axle;
  Travel<V> travel;
};

template <class V, int NB>
struct Forces {
  V body[NB];
  V axle[kMaxAxles], unclipped[kMaxAxles], horizontal[kMaxAxles], pull[kMaxAxles], extension[kMaxAxles];
};

// Where each wheel is: how far it is ahead of the looked-up road, its forward speed, its rise and rate of rise.
template <class V>
struct Wheels {
  V advance[kMaxAxles], speed[kMaxAxles];
  const V *rise, *rise_rate;
};

inline void contacts(const Run& run, const Laws<Pack>& laws, const RoadPoint* road, double, const Wheels<Pack>& wheel,
                     Pack* unclipped, Pack* drag) {
  for (int i = 0; i < run.axles; ++i) {
    const AxleLaw<Pack>& law = laws.axle[i];
    Squash<Pack> now;
    if (road[i].flat) {
      now.deflection = law.static_deflection - wheel.rise[i];
      now.rate = -wheel.rise_rate[i];
    } else {
      const MapRow* order = road[i].order;
      RoadRows<double> rows{order[0][0], order[1][0], order[2][0], order[3][0], {}, {}};
      for (int k = 0; k < 3; ++k) {
        for (int row = 0; row < 4; ++row) rows.stretch[row][k] = order[k][1 + row];
        for (int row = 0; row < 3; ++row) rows.drag[row][k] = order[k][5 + row];
      }
      now = squash(rows, law.static_deflection, wheel.advance[i], wheel.speed[i], wheel.rise[i], wheel.rise_rate[i]);
      drag[i] = now.drag;
    }
    unclipped[i] = tire_force(now.deflection, now.rate, law.inverse_reference, law.exponent, law.tire_damping,
                              splat(law.reference_load), run.growth);
  }
}

// Lanes are axles here: partial derivatives of every axle's force, then the chain rule along each row of derivatives.
template <int T>
void contacts(const Run& run, const Laws<Jet<T>>& laws, const RoadPoint* road, double time, const Wheels<Jet<T>>& wheel,
              Jet<T>* unclipped, Jet<T>* drag) {
  enum { kRest, kAdvance, kSpeed, kRise, kRiseRate, kAhead, kInputs };
  enum { kDeflection, kRate, kInverse, kExponent, kDamping, kForceInputs };
  const Travel<Jet<T>>& travel = laws.travel;
  const Jet<T> ahead = (time - run.start) * travel.ahead_rate + travel.ahead_start;
  for (int first = 0; first < run.axles; first += kLanes) {
    const int count = run.axles - first < kLanes ? run.axles - first : kLanes;
    Pack rest = splat(1.0), advance{}, speed{}, rise{}, rise_rate{}, inverse = splat(1.0), exponent = splat(1.0),
         damping{}, load{};
    bool flat = true;
    for (int k = 0; k < count; ++k) {
      const int i = first + k;
      const AxleLaw<Jet<T>>& law = laws.axle[i];
      rest[k] = law.static_deflection.d[0][0];
      inverse[k] = law.inverse_reference.d[0][0];
      exponent[k] = law.exponent.d[0][0];
      damping[k] = law.tire_damping.d[0][0];
      load[k] = law.reference_load;
      rise[k] = wheel.rise[i].d[0][0];
      rise_rate[k] = wheel.rise_rate[i].d[0][0];
      if (!road[i].flat) {
        flat = false;
        advance[k] = wheel.advance[i].d[0][0];
        speed[k] = wheel.speed[i].d[0][0];
      }
    }
    using Inner = Local<kInputs>;
    Squash<Inner> now;
    if (flat) {
      now.deflection = variable<kInputs>(rest, kRest) - variable<kInputs>(rise, kRise);
      now.rate = -variable<kInputs>(rise_rate, kRiseRate);
      now.drag = constant<kInputs>(Pack{});
    } else {
      MapRow order[kOrders][kLanes] = {};
      for (int k = 0; k < count; ++k)
        if (!road[first + k].flat)
          for (int n = 0; n < kOrders; ++n) order[n][k] = road[first + k].order[n];
      // Looked up `ahead` further on: the value moves with the next derivative.
      const auto row = [&](int n, int which) {
        Inner x = constant<kInputs>(Pack{});
        for (int k = 0; k < kLanes; ++k) x.v[k] = order[n][k][which], x.d[kAhead][k] = order[n + 1][k][which];
        return x;
      };
      RoadRows<Inner> rows;
      rows.rise = row(0, 0), rows.slope = row(1, 0), rows.second = row(2, 0), rows.third = row(3, 0);
      for (int n = 0; n < 3; ++n) {
        for (int which = 0; which < 4; ++which) rows.stretch[which][n] = row(n, 1 + which);
        for (int which = 0; which < 3; ++which) rows.drag[which][n] = row(n, 5 + which);
      }
      now = squash(rows, variable<kInputs>(rest, kRest), variable<kInputs>(advance, kAdvance),
                   variable<kInputs>(speed, kSpeed), variable<kInputs>(rise, kRise),
                   variable<kInputs>(rise_rate, kRiseRate));
    }
    const Local<kForceInputs> force =
        tire_force(variable<kForceInputs>(now.deflection.v, kDeflection), variable<kForceInputs>(now.rate.v, kRate),
                   variable<kForceInputs>(inverse, kInverse), variable<kForceInputs>(exponent, kExponent),
                   variable<kForceInputs>(damping, kDamping), load, run.growth);
    Pack by[kInputs];
    for (int n = 0; n < kInputs; ++n)
      by[n] = force.d[kDeflection] * now.deflection.d[n] + force.d[kRate] * now.rate.d[n];
    for (int k = 0; k < count; ++k) {
      const int i = first + k;
      const AxleLaw<Jet<T>>& law = laws.axle[i];
      const auto with_value = [](Jet<T> x, double v) {
        x.d[0][0] = v;
        return x;
      };
      Jet<T> slopes = by[kRest][k] * law.static_deflection + force.d[kInverse][k] * law.inverse_reference +
                      force.d[kExponent][k] * law.exponent + force.d[kDamping][k] * law.tire_damping +
                      by[kRise][k] * wheel.rise[i] + by[kRiseRate][k] * wheel.rise_rate[i];
      if (!road[i].flat) {
        slopes += by[kAdvance][k] * wheel.advance[i] + by[kSpeed][k] * wheel.speed[i] + by[kAhead][k] * ahead;
        const Local<kInputs>& h = now.drag;
        drag[i] = with_value(h.d[kRest][k] * law.static_deflection + h.d[kAdvance][k] * wheel.advance[i] +
                                 h.d[kRise][k] * wheel.rise[i] + h.d[kAhead][k] * ahead,
                             h.v[k]);
      }
      unclipped[i] = with_value(slopes, force.v[k]);
    }
  }
}

// What the clipped force's integrals over the step have beyond the stages' own, per axle: I_1 - (f_1 + 2 f_2 + 2 f_3 +
// f_4) / 6 and I_2 - (f_1 + f_2 + f_3) / 6.  Both vanish where the force keeps its sign over the step.
inline bool changes_sign(Pack p1, Pack p2, Pack p3, Pack p4, Mask& where) {
  // q in Bernstein form: of one sign if its three coefficients are.
  const Pack control = p2 + p3 - 0.5 * (p1 + p4);
  const Mask above = (p1 >= 0.0) & (p2 >= 0.0) & (p3 >= 0.0) & (p4 >= 0.0) & (control >= 0.0);
  const Mask below = (p1 <= 0.0) & (p2 <= 0.0) & (p3 <= 0.0) & (p4 <= 0.0) & (control <= 0.0);
  where = ~(above | below);
  return any(where);
}

inline bool lift_off(Pack p1, Pack p2, Pack p3, Pack p4, Pack& impulse, Pack& moment) {
  Mask where;
  if (!changes_sign(p1, p2, p3, p4, where)) return false;
  const Pack f1 = positive(p1), f2 = positive(p2), f3 = positive(p3), f4 = positive(p4);
  clipped_integrals(p1, 0.5 * (p2 + p3), p4, impulse, moment);
  impulse = select(where, impulse - (f1 + 2.0 * f2 + 2.0 * f3 + f4) * (1.0 / 6.0), Pack{});
  moment = select(where, moment - (f1 + f2 + f3) * (1.0 / 6.0), Pack{});
  return true;
}

template <int T>
bool lift_off(const Jet<T>& p1, const Jet<T>& p2, const Jet<T>& p3, const Jet<T>& p4, Jet<T>& impulse, Jet<T>& moment) {
  Mask where;
  const Jet<T> middle = 0.5 * (p2 + p3);
  const Pack start = splat(p1.d[0][0]), half = splat(middle.d[0][0]), end = splat(p4.d[0][0]);
  if (!changes_sign(start, splat(p2.d[0][0]), splat(p3.d[0][0]), end, where)) return false;
  Local<3> whole, weighted;
  clipped_integrals(variable<3>(start, 0), variable<3>(half, 1), variable<3>(end, 2), whole, weighted);
  const auto chain = [&](const Local<3>& x) {
    Jet<T> y = x.d[0][0] * p1 + x.d[1][0] * middle + x.d[2][0] * p4;
    y.d[0][0] = x.v[0];
    return y;
  };
  const Jet<T> f1 = positive(p1), f2 = positive(p2), f3 = positive(p3), f4 = positive(p4);
  impulse = chain(whole) - (1.0 / 6.0) * (f1 + 2.0 * (f2 + f3) + f4);
  moment = chain(weighted) - (1.0 / 6.0) * (f1 + f2 + f3);
  return true;
}

// Suspension force that pulls body and axle together, from extension e and its rate: k e + c de/dt.
template <class V>
inline V suspension_pull(const AxleLaw<V>& law, const V& extension, const V& rate) {
  return product(law.stiffness, extension) + product(law.damping, rate);
}

// Accelerations and forces in the state (body coordinates b, axle rises z, and rates):
//   axle:  m_u z'' = V - static load + pull,      body: b'' = A [pull; H] - M^-1 (tilt b + hold b').
template <class V, int NB>
void forces(const Run& run, const Laws<V>& laws, const RoadPoint* road, double time, const V* b, const V* b_rate,
            const V* z, const V* z_rate, Forces<V, NB>& out) {
  const int na = run.axles;
  Wheels<V> wheel;
  wheel.rise = z;
  wheel.rise_rate = z_rate;
  V drag[kMaxAxles], extension_rate[kMaxAxles];
  for (int i = 0; i < na; ++i) {
    const double *up = run.position + i * NB, *up_rate = run.rate + i * NB;
    V above = zero<V>() - z[i], above_rate = zero<V>() - z_rate[i];
    for (int j = 0; j < NB; ++j) above += up[j] * b[j], above_rate += up_rate[j] * b_rate[j];
    out.extension[i] = above;
    extension_rate[i] = above_rate;
    if (road[i].flat) continue;
    const double *along = run.position + (na + i) * NB, *along_rate = run.rate + (na + i) * NB;
    V advance = along[0] * b[0], speed = laws.travel.speed;
    for (int j = 1; j < NB; ++j) advance += along[j] * b[j];
    for (int j = 0; j < NB; ++j) speed += along_rate[j] * b_rate[j];
    wheel.advance[i] = advance;
    wheel.speed[i] = speed;
  }
  contacts(run, laws, road, time, wheel, out.unclipped, drag);
  V body[NB];
  for (int j = 0; j < NB; ++j) {
    const double *tilt = run.position + (2 * na + j) * NB, *hold = run.rate + (2 * na + j) * NB;
    body[j] = tilt[0] * b[0];
    for (int l = 1; l < NB; ++l) body[j] += tilt[l] * b[l];
    for (int l = 0; l < NB; ++l) body[j] += hold[l] * b_rate[l];
  }
  for (int i = 0; i < na; ++i) {
    const V pull = suspension_pull(laws.axle[i], out.extension[i], extension_rate[i]);
    const V vertical = positive(out.unclipped[i]);
    out.pull[i] = pull;
    out.axle[i] = run.inverse_unsprung[i] * plus(vertical + pull, -run.static_load[i]);
    for (int j = 0; j < NB; ++j) body[j] += run.acceleration[j * 2 * na + i] * pull;
    if (road[i].flat) {
      out.horizontal[i] = zero<V>();
    } else {
      out.horizontal[i] = product(drag[i], vertical);
      for (int j = 0; j < NB; ++j) body[j] += run.acceleration[j * 2 * na + na + i] * out.horizontal[i];
    }
  }
  for (int j = 0; j < NB; ++j) out.body[j] = body[j];
}

// Signals in the order of the channels: deflections, axle accelerations, body accelerations.
struct Channels {
  std::vector<int> deflection, acceleration;
  int body;
  int count() const { return static_cast<int>(deflection.size() + acceleration.size()) + body; }
};

template <class V, int NB>
void observe(const Run& run, const Channels& channels, const V* extension, const V* axle, const V* body, V* signal) {
  for (int i : channels.deflection) *signal++ = extension[i];
  for (int i : channels.acceleration) *signal++ = axle[i];
  for (int k = 0; k < channels.body; ++k) {
    const double* row = run.body_rows + k * NB;
    V sum = row[0] * body[0];
    for (int j = 1; j < NB; ++j) sum += row[j] * body[j];
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

struct Clock {
  int64_t samples, substeps;
  double interval;
};

// Integrates one run and hands over what `sink` asks for at every sample: sink(sample, forces, body, shown).
//
// The step is the classical fourth-order Runge-Kutta scheme in its second-order (Nystrom) form with the exact integral
// of the clipped tire force.  The start is the static equilibrium, so nothing moves before a wheel reaches the bump.
template <class V, int NB, bool Filtered, class Sink>
void integrate(const Run& run, const Laws<V>& laws, const Channels& channels, const Filter& filter, const Clock& clock,
               Sink&& sink) {
  const int na = run.axles, nc = channels.count(), poles = static_cast<int>(filter.pole.size());
  const double h = clock.interval / static_cast<double>(clock.substeps), half = 0.5 * h;
  const double half_step = clock.interval / static_cast<double>(2 * clock.substeps);
  std::vector<WheelRoad> wheels;
  for (int i = 0; i < na; ++i) wheels.emplace_back(run.road, i);
  RoadPoint road[3][kMaxAxles];
  const auto look_up = [&](int64_t half_steps, RoadPoint* points) {
    const double time = static_cast<double>(half_steps) * half_step;
    bool flat = true;
    for (int i = 0; i < na; ++i) {
      wheels[i].look_up(run.speed * (time - run.start) - run.axle_x[i], points[i]);
      flat = flat && points[i].flat;
    }
    return flat;
  };
  V b[NB], vb[NB], z[kMaxAxles], vz[kMaxAxles];
  V stage_b[NB], stage_vb[NB], stage_z[kMaxAxles], stage_vz[kMaxAxles], kick[kMaxAxles];
  for (int j = 0; j < NB; ++j) b[j] = vb[j] = zero<V>();
  for (int i = 0; i < na; ++i) z[i] = vz[i] = zero<V>();
  std::vector<V> real(poles * nc, zero<V>()), imaginary(poles * nc, zero<V>());
  std::vector<V> now(nc), middle(nc), shown(nc);
  std::vector<Forces<V, NB>> work(4);
  Forces<V, NB>&first = work[0], &second = work[1], &third = work[2], &fourth = work[3];

  bool resting = look_up(0, road[0]);
  const int64_t steps = (clock.samples - 1) * clock.substeps + 1;
  for (int64_t step = 0; step < steps; ++step) {
    const double time = static_cast<double>(step) * h;
    const bool sampled = step % clock.substeps == 0;
    if (step > 0)
      for (int i = 0; i < na; ++i) road[0][i] = road[2][i];
    const bool middle_flat = look_up(2 * step + 1, road[1]), end_flat = look_up(2 * step + 2, road[2]);
    resting = resting && middle_flat && end_flat;
    if (!resting || step == 0) forces<V, NB>(run, laws, road[0], time, b, vb, z, vz, first);
    if (resting) {
      // Forces cancel up to rounding here: what is at rest stays at rest.
      for (int j = 0; j < NB; ++j) first.body[j] = zero<V>();
      for (int i = 0; i < na; ++i) first.axle[i] = first.pull[i] = zero<V>();
    }
    if (Filtered || sampled) observe<V, NB>(run, channels, first.extension, first.axle, first.body, now.data());
    if (sampled) {
      if (Filtered) {
        for (int c = 0; c < nc; ++c) {
          V sum = filter.direct * now[c];
          for (int k = 0; k < poles; ++k) {
            const double* w = filter.pole[k].weight;
            sum += w[0] * real[k * nc + c] - w[1] * imaginary[k * nc + c];
          }
          shown[c] = sum;
        }
      }
      sink(step / clock.substeps, first, b, Filtered ? shown.data() : now.data());
    }
    if (resting || step + 1 == steps) continue;

    for (int j = 0; j < NB; ++j) {
      stage_b[j] = b[j] + half * vb[j];
      stage_vb[j] = vb[j] + half * first.body[j];
    }
    for (int i = 0; i < na; ++i) {
      stage_z[i] = z[i] + half * vz[i];
      stage_vz[i] = vz[i] + half * first.axle[i];
    }
    forces<V, NB>(run, laws, road[1], time + half, stage_b, stage_vb, stage_z, stage_vz, second);
    for (int j = 0; j < NB; ++j) {
      stage_b[j] += half * half * first.body[j];
      stage_vb[j] = vb[j] + half * second.body[j];
    }
    for (int i = 0; i < na; ++i) {
      stage_z[i] += half * half * first.axle[i];
      stage_vz[i] = vz[i] + half * second.axle[i];
    }
    forces<V, NB>(run, laws, road[1], time + half, stage_b, stage_vb, stage_z, stage_vz, third);
    for (int j = 0; j < NB; ++j) {
      stage_b[j] = b[j] + h * (vb[j] + half * second.body[j]);
      stage_vb[j] = vb[j] + h * third.body[j];
    }
    for (int i = 0; i < na; ++i) {
      stage_z[i] = z[i] + h * (vz[i] + half * second.axle[i]);
      stage_vz[i] = vz[i] + h * third.axle[i];
    }
    forces<V, NB>(run, laws, road[2], time + h, stage_b, stage_vb, stage_z, stage_vz, fourth);

    const auto advance = [&](V& x, V& v, const V& a1, const V& a2, const V& a3, const V& a4) {
      x += h * v + h * h / 6.0 * (a1 + a2 + a3);
      v += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
    };
    for (int j = 0; j < NB; ++j)
      advance(b[j], vb[j], first.body[j], second.body[j], third.body[j], fourth.body[j]);
    for (int i = 0; i < na; ++i) {
      advance(z[i], vz[i], first.axle[i], second.axle[i], third.axle[i], fourth.axle[i]);
      kick[i] = zero<V>();
      V impulse, moment;
      if (lift_off(first.unclipped[i], second.unclipped[i], third.unclipped[i], fourth.unclipped[i], impulse, moment)) {
        kick[i] = h * run.inverse_unsprung[i] * impulse;
        vz[i] += kick[i];
        z[i] += h * h * run.inverse_unsprung[i] * moment;
      }
    }
    if (!Filtered) continue;
    // At lift-off the filter's quadratic through start, middle and end has the exact impulse of the clipped force.
    for (int i = 0; i < na; ++i) {
      stage_z[i] = 0.5 * (second.extension[i] + third.extension[i]);
      stage_vz[i] = 0.5 * (second.axle[i] + third.axle[i]) + 1.5 / h * kick[i];
    }
    for (int j = 0; j < NB; ++j) stage_b[j] = 0.5 * (second.body[j] + third.body[j]);
    observe<V, NB>(run, channels, stage_z, stage_vz, stage_b, middle.data());
    for (int k = 0; k < poles; ++k) {
      const Pole& p = filter.pole[k];
      V *re = &real[k * nc], *im = &imaginary[k * nc];
      for (int c = 0; c < nc; ++c) {
        const V x = re[c], y = im[c];
        re[c] = p.decay[0] * x - p.decay[1] * y + p.start[0] * now[c] + p.middle[0] * middle[c];
        im[c] = p.decay[1] * x + p.decay[0] * y + p.start[1] * now[c] + p.middle[1] * middle[c];
      }
    }
  }
}

}  // namespace sysid
