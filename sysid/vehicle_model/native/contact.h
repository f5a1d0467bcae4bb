// The road under a wheel, and the contact of a tire with it (equations of contact.py and kink.py).

#pragma once

#include <type_traits>
#include <vector>

#include "buffers.h"
#include "row.h"

namespace sysid {

constexpr int kMapRows = 1 + kStretchRows + kDragRows;  // rise, alpha_1, alpha_2, alpha_3, lift, beta_0, beta_1, beta_2
constexpr int kOrders = 5;   // value and four derivatives along the road
constexpr double kFurthest = 0.25;  // wheels are at most so far from where they are at the speed that is held [m]

// ---------------------------------------------------------------------------------------------------------- the road

// Eight rows of a map at one position: they are looked up together.
typedef double MapRow __attribute__((vector_size(kMapRows * 8)));

// Quintic B-spline coefficients of one run: rise (na, n), stretch (4, na, n), drag (3, na, n), rows `stride` apart.
struct RoadTable {
  const double* rise;
  const double* stretch;  // null: a point follower
  const double* drag;
  int64_t stations, stride;
  bool common_map;  // several runs have this stretch and drag
  bool edged;       // looked up where the wheels are
  double first_station, step;
  const double* polynomial;  // (6, 6) from the coefficients around a cell to powers of the position in it
};

// The road under one wheel: order[k] is the k-th derivative along the road of the eight rows.
struct RoadPoint {
  MapRow order[kOrders];
  bool flat = false;
};

// The first `orders` derivatives along the road, at t in a cell, of eight polynomials of the place in the cell.
inline void derivatives(const MapRow (&term)[kCellPowers], double t, double step, int orders, MapRow* found) {
  static constexpr double kFactor[kOrders][kCellPowers] = {
      {1, 1, 1, 1, 1, 1}, {1, 2, 3, 4, 5, 0}, {2, 6, 12, 20, 0, 0}, {6, 24, 60, 0, 0, 0}, {24, 120, 0, 0, 0, 0}};
  double scale = 1.0;
  for (int order = 0; order < orders; ++order) {
    MapRow sum = kFactor[order][5 - order] * term[5];
    for (int power = 4; power >= order; --power) sum = sum * t + kFactor[order][power - order] * term[power];
    found[order] = sum * scale;
    scale /= step;
  }
}

// Looks the road up under one wheel; remembers the cell it was in.
class WheelRoad {
 public:
  WheelRoad(const RoadTable& table, int axle) : table_(table), axle_(axle) {
    const auto felt = [&](int64_t station) {
      MapRow w;
      coefficients(station, w);
      for (int row = 0; row < kMapRows; ++row)
        if (!(std::abs(w[row]) < 1e-22)) return true;
      return false;
    };
    int64_t from = 0, to = table.stations - 1;
    while (from < table.stations && !felt(from)) ++from;
    while (to >= from && !felt(to)) --to;
    // A cell is made from the coefficients at two stations before it to three after it.
    const double further = table.edged ? kFurthest / table.step : 0.0;
    begin = static_cast<double>(from - 3) - further;
    end = from <= to ? static_cast<double>(to + 3) + further : begin;
  }

  // Where the road is not flat, in cells: outside the bump all coefficients are zero.
  double begin, end;

  // The road at a place in cells, within the table.
  void look_up(double scaled, RoadPoint& point) {
    const int64_t cell = static_cast<int64_t>(scaled);
    if (cell != cell_) enter(cell);
    derivatives(term_, scaled - static_cast<double>(cell), table_.step, kOrders, point.order);
  }

 private:
  // By reference: how a function returns so wide a vector depends on the processor.
  void coefficients(int64_t station, MapRow& w) const {
    const int64_t at = axle_ * table_.stations + station;
    w = MapRow{};
    w[0] = table_.rise[at];
    if (table_.stretch != nullptr) {
      for (int row = 0; row < kStretchRows; ++row) w[1 + row] = table_.stretch[row * table_.stride + at];
      for (int row = 0; row < kDragRows; ++row) w[1 + kStretchRows + row] = table_.drag[row * table_.stride + at];
    }
  }

  // Polynomials of the cell.
  void enter(int64_t cell) {
    MapRow weight[kCellPowers]{};
    for (int k = 0; k < kCellPowers; ++k) coefficients(cell - 2 + k, weight[k]);
    cell_ = cell;
    for (int power = 0; power < kCellPowers; ++power) {
      term_[power] = MapRow{};
      for (int k = 0; k < kCellPowers; ++k) term_[power] += table_.polynomial[kCellPowers * power + k] * weight[k];
    }
  }

  const RoadTable& table_;
  int64_t axle_;
  int64_t cell_ = -1;
  MapRow term_[kCellPowers];
};

// --------------------------------------------------------------------------------------------------- tire and contact

template <class T>
struct Squash {
  T deflection, rate, drag;
};

// Rows of the road and their derivatives as numbers of type Q (`lift` is where the undeformed wheel first touches).
// Where only rise and beta_0 are not zero, the footprint is `even` and the other rows are not looked at.
template <class Q>
struct RoadRows {
  Q rise, slope, second, third;
  Q stretch[4][3];  // alpha_1, alpha_2, alpha_3, lift: value, first and second derivative
  Q drag[3][3];     // beta_0, beta_1, beta_2
  bool even = false;
};

// The road under one wheel of several runs, flat if it is so for all of them.
struct PackedPoint {
  RoadRows<Pack> rows;
  bool flat = false;
};

// The road as runs with constants M see it.
template <class M>
struct PointOf {
  using type = RoadPoint;
};
template <>
struct PointOf<Pack> {
  using type = PackedPoint;
};
template <class M>
using PointFor = typename PointOf<M>::type;

inline RoadRows<double> road_rows(const RoadPoint& point) {
  const MapRow* order = point.order;
  RoadRows<double> rows{order[0][0], order[1][0], order[2][0], order[3][0], {}, {}};
  for (int k = 0; k < 3; ++k) {
    for (int row = 0; row < kStretchRows; ++row) rows.stretch[row][k] = order[k][1 + row];
    for (int row = 0; row < kDragRows; ++row) rows.drag[row][k] = order[k][1 + kStretchRows + row];
  }
  return rows;
}
inline const RoadRows<Pack>& road_rows(const PackedPoint& point) { return point.rows; }

// From the road of one run, or of the runs of all lanes.
inline void gather(const RoadPoint* of_lanes, RoadPoint& point) { point = of_lanes[0]; }
inline void gather(const RoadPoint* of_lanes, PackedPoint& point) {
  const auto packed = [&](int order, int row) {
    Pack x;
    for (int k = 0; k < kLanes; ++k) x[k] = of_lanes[k].order[order][row];
    return x;
  };
  RoadRows<Pack>& rows = point.rows;
  rows.even = false;
  rows.rise = packed(0, 0), rows.slope = packed(1, 0), rows.second = packed(2, 0), rows.third = packed(3, 0);
  for (int n = 0; n < 3; ++n) {
    for (int row = 0; row < kStretchRows; ++row) rows.stretch[row][n] = packed(n, 1 + row);
    for (int row = 0; row < kDragRows; ++row) rows.drag[row][n] = packed(n, 1 + kStretchRows + row);
  }
}

// The road under one wheel of several runs with one footprint map, where all of them are at the same place: the weights
// of the coefficients are the same for all lanes and rows.
class CommonMap {
 public:
  CommonMap(const std::vector<RoadTable>& tables, int axle) : step_(tables[0].step) {
    for (const RoadTable& table : tables) rise_.push_back(table.rise + axle * table.stations);
    for (int power = 0; power < kCellPowers; ++power) {
      term_[power] = MapRow{};
      for (int k = 0; k < kCellPowers; ++k) term_[power][k] = tables[0].polynomial[kCellPowers * power + k];
    }
    const RoadTable& table = tables[0];
    for (int row = 0; row < kStretchRows + kDragRows; ++row) {
      const double* of = row < kStretchRows ? table.stretch + row * table.stride
                                            : table.drag + (row - kStretchRows) * table.stride;
      of += axle * table.stations;
      for (int64_t k = 0; k < table.stations && map_[row] == nullptr; ++k)
        if (!(std::abs(of[k]) < 1e-22)) map_[row] = of;
      if (row != kStretchRows && map_[row] != nullptr) even_ = false;
    }
  }

  // The road at a place in cells, within the table.
  void look_up(double scaled, PackedPoint& point) const {
    static_assert(kCellPowers <= kMapRows);
    const int64_t cell = static_cast<int64_t>(scaled), from = cell - 2;
    MapRow weight[4];
    derivatives(term_, scaled - static_cast<double>(cell), step_, 4, weight);
    RoadRows<Pack>& rows = point.rows;
    Pack order[4]{};
    for (int k = 0; k < kCellPowers; ++k) {
      Pack coefficient;
      for (int lane = 0; lane < kLanes; ++lane) coefficient[lane] = rise_[lane][from + k];
      for (int n = 0; n < 4; ++n) order[n] += weight[n][k] * coefficient;
    }
    rows.rise = order[0], rows.slope = order[1], rows.second = order[2], rows.third = order[3];
    rows.even = even_;
    for (int row = 0; row < kStretchRows + kDragRows; ++row) {
      if (even_ && row != kStretchRows) continue;
      for (int n = 0; n < 3; ++n) {
        double sum = 0.0;
        if (map_[row] != nullptr)
          for (int k = 0; k < kCellPowers; ++k) sum += weight[n][k] * map_[row][from + k];
        (row < kStretchRows ? rows.stretch[row][n] : rows.drag[row - kStretchRows][n]) = splat(sum);
      }
    }
  }

 private:
  double step_;
  std::vector<const double*> rise_;                     // of each lane
  const double* map_[kStretchRows + kDragRows] = {};  // null where all coefficients are zero
  bool even_ = true;
  MapRow term_[kCellPowers];
};

// The road under one wheel of one run, or of the runs of all lanes.
template <class M>
class RoadUnderWheel {
 public:
  RoadUnderWheel(const std::vector<RoadTable>& tables, int axle)
      : first_(tables[0].first_station), step_(tables[0].step), last_(static_cast<double>(tables[0].stations) - 4.0) {
    for (const RoadTable& table : tables) {
      each_.emplace_back(table, axle);
      const int lane = static_cast<int>(each_.size()) - 1;
      set_lane(begin_, lane, each_.back().begin);
      set_lane(end_, lane, each_.back().end);
    }
    if (tables[0].common_map) common_.emplace_back(tables, axle);
  }

  // The road at a place [m]; returns where it is not flat.
  Where<M> look_up(const M& position, PointFor<M>& point) {
    M scaled = (position - first_) / step_;
    scaled = select(scaled < 2.0, 2.0 - M{}, select(scaled > last_, last_ - M{}, scaled));
    const Where<M> felt = (scaled >= begin_) & (scaled < end_);
    point.flat = !any(felt);
    if (point.flat) return felt;
    if constexpr (std::is_same_v<M, Pack>) {
      if (!common_.empty() && !any(opposite(felt) | (scaled != splat(scaled[0])))) {
        common_[0].look_up(scaled[0], point);
        return felt;
      }
    }
    RoadPoint of_lanes[kLanes];
    for (size_t k = 0; k < each_.size(); ++k) {
      // A lane does not depend on what the others meet.
      if (at_lane(felt, k))
        each_[k].look_up(at_lane(scaled, k), of_lanes[k]);
      else
        of_lanes[k] = {};
    }
    gather(of_lanes, point);
    point.flat = false;
    return felt;
  }

 private:
  double first_, step_, last_;
  M begin_{}, end_{};
  std::vector<WheelRoad> each_;
  std::vector<CommonMap> common_;  // one, where runs have one footprint map
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
  if (road.even) return {u0 + below, below_rate, moved(road.drag[0], advance)};
  const T a = moved(road.stretch[0], advance), b = moved(road.stretch[1], advance), c = moved(road.stretch[2], advance);
  const T da = moved_slope(road.stretch[0], advance), db = moved_slope(road.stretch[1], advance),
          dc = moved_slope(road.stretch[2], advance);
  const T lowest = moved(road.stretch[3], advance) - u0;
  const auto touching = value(below) > value(lowest);
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
                    Pack reference_load, Pack growth) {
  const T relative = deflection * inverse_reference;
  const T size = absolute(relative);
  const Pack sign = select(value(size) > kNoDeflection, sign_of(value(relative)), Pack{});
  const T elastic = (reference_load * sign) * power(size, exponent);
  const T length = (std::sqrt(1.0 + kSoftDamping) * size) * reciprocal_root(size + splat(kSoftDamping));
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

// What the integrals of a clipped quantity over the step have beyond those of the four stages:
//   I_1 - (f_1 + 2 f_2 + 2 f_3 + f_4) / 6   and   I_2 - (f_1 + f_2 + f_3) / 6,   f = max(0, p).
// Returns false, and leaves both alone, where the quantity keeps its sign over the step: they vanish there.
inline Mask changes_sign(Pack p1, Pack p2, Pack p3, Pack p4) {
  // q in Bernstein form: of one sign if its three coefficients are.
  const Pack control = p2 + p3 - 0.5 * (p1 + p4);
  const Mask above = (p1 >= 0.0) & (p2 >= 0.0) & (p3 >= 0.0) & (p4 >= 0.0) & (control >= 0.0);
  const Mask below = (p1 <= 0.0) & (p2 <= 0.0) & (p3 <= 0.0) & (p4 <= 0.0) & (control <= 0.0);
  return ~(above | below);
}

inline bool missed_by_stages(const Pack& p1, const Pack& p2, const Pack& p3, const Pack& p4, Pack& impulse,
                             Pack& moment) {
  const Mask where = changes_sign(p1, p2, p3, p4);
  if (!any(where)) return false;
  const Pack f1 = positive(p1), f2 = positive(p2), f3 = positive(p3), f4 = positive(p4);
  clipped_integrals(p1, 0.5 * (p2 + p3), p4, impulse, moment);
  impulse = select(where, impulse - (f1 + 2.0 * f2 + 2.0 * f3 + f4) * (1.0 / 6.0), Pack{});
  moment = select(where, moment - (f1 + f2 + f3) * (1.0 / 6.0), Pack{});
  return true;
}

template <int T>
bool missed_by_stages(const Jet<T>& p1, const Jet<T>& p2, const Jet<T>& p3, const Jet<T>& p4, Jet<T>& impulse,
                      Jet<T>& moment) {
  const Jet<T> middle = 0.5 * (p2 + p3);
  const Pack start = splat(value(p1)), half = splat(value(middle)), end = splat(value(p4));
  if (!any(changes_sign(start, splat(value(p2)), splat(value(p3)), end))) return false;
  Local<3> whole, weighted;
  clipped_integrals(variable<3>(start, 0), variable<3>(half, 1), variable<3>(end, 2), whole, weighted);
  const auto chain = [&](const Local<3>& x) {
    Jet<T> y = x.d[0][0] * p1 + x.d[1][0] * middle + x.d[2][0] * p4;
    y.set_value(x.v[0]);
    return y;
  };
  const Jet<T> f1 = positive(p1), f2 = positive(p2), f3 = positive(p3), f4 = positive(p4);
  impulse = chain(whole) - (1.0 / 6.0) * (f1 + 2.0 * (f2 + f3) + f4);
  moment = chain(weighted) - (1.0 / 6.0) * (f1 + f2 + f3);
  return true;
}

}  // namespace sysid
