// Packs that count what is done with them: in place of the vectors of pack.h and contact.h (see flop_count.py).
//
// One operation of a pack is one operation of each parameter set in it.  Rows of the road are looked up once for all sets
// of a pack; they are counted by themselves, number by number.

#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

namespace sysid {

enum { kAdd, kMultiply, kDivide, kRoot, kOther, kOperations };  // kOther: comparisons, selections, signs, bits
enum { kSets, kRoad, kKinds };

struct Count {
  uint64_t of[kOperations] = {};
};
inline Count counted[kKinds];

template <int N, int Kind>
struct Counted {
  double lane[N] = {};

  Counted() = default;
  explicit Counted(Bits bits) { std::memcpy(lane, &bits, sizeof lane); }
  explicit operator Bits() const {
    Bits bits;
    std::memcpy(&bits, lane, sizeof lane);
    count(kOther);
    return bits;
  }
  static Counted of(double x) {
    Counted y;
    for (double& l : y.lane) l = x;
    return y;
  }
  double& operator[](int k) { return lane[k]; }
  double operator[](int k) const { return lane[k]; }

  static void count(int operation) { counted[Kind].of[operation] += Kind == kRoad ? N : 1; }
  template <class F>
  static Counted each(int operation, const Counted& a, const Counted& b, F&& f) {
    count(operation);
    Counted y;
    for (int k = 0; k < N; ++k) y.lane[k] = f(a.lane[k], b.lane[k]);
    return y;
  }
  template <class F>
  static Mask compare(const Counted& a, const Counted& b, F&& f) {
    count(kOther);
    Mask m;
    for (int k = 0; k < N; ++k) m[k] = f(a.lane[k], b.lane[k]) ? -1 : 0;
    return m;
  }

#define SYSID_ARITHMETIC(symbol, operation)                                                     \
  friend Counted operator symbol(const Counted& a, const Counted& b) {                          \
    return each(operation, a, b, [](double x, double y) { return x symbol y; });                \
  }                                                                                             \
  friend Counted operator symbol(double a, const Counted& b) { return of(a) symbol b; }         \
  friend Counted operator symbol(const Counted& a, double b) { return a symbol of(b); }         \
  Counted& operator symbol##=(const Counted& b) { return *this = *this symbol b; }              \
  Counted& operator symbol##=(double b) { return *this = *this symbol b; }
#define SYSID_COMPARISON(symbol)                                                                \
  friend Mask operator symbol(const Counted& a, const Counted& b) {                             \
    return compare(a, b, [](double x, double y) { return x symbol y; });                        \
  }                                                                                             \
  friend Mask operator symbol(const Counted& a, double b) { return a symbol of(b); }
  SYSID_ARITHMETIC(+, kAdd)
  SYSID_ARITHMETIC(-, kAdd)
  SYSID_ARITHMETIC(*, kMultiply)
  SYSID_ARITHMETIC(/, kDivide)
  SYSID_COMPARISON(<)
  SYSID_COMPARISON(<=)
  SYSID_COMPARISON(>)
  SYSID_COMPARISON(>=)
  SYSID_COMPARISON(==)
  SYSID_COMPARISON(!=)
#undef SYSID_ARITHMETIC
#undef SYSID_COMPARISON
  friend Counted operator-(const Counted& a) {
    return each(kOther, a, a, [](double x, double) { return -x; });
  }
};

typedef Counted<kLanes, kSets> Pack;
typedef Counted<8, kRoad> MapRow;

inline Pack splat(double x) { return Pack::of(x); }

inline Pack select(Mask where, Pack yes, Pack no) {
  Pack::count(kOther);
  for (int k = 0; k < kLanes; ++k)
    if (!where[k]) yes.lane[k] = no.lane[k];
  return yes;
}

inline Pack square_root(Pack x) {
  return Pack::each(kRoot, x, x, [](double l, double) { return std::sqrt(l); });
}

#if defined(__AVX512F__) && defined(__AVX512DQ__)  // the instructions that pack.h calls SYSID_SCALES
inline Pack one_of(const Pack& x, double (*f)(double)) {
  Pack::count(kOther);
  Pack y;
  for (int k = 0; k < kLanes; ++k) y.lane[k] = f(x.lane[k]);
  return y;
}
inline Pack exponent_of(Pack x) { return one_of(x, [](double l) { return std::logb(l); }); }
inline Pack mantissa_of(Pack x) {
  return one_of(x, [](double l) { return l == 0.0 ? 1.0 : std::scalbn(l, -std::ilogb(l)); });
}
inline Pack integer_of(Pack x) { return one_of(x, [](double l) { return std::nearbyint(l); }); }
inline Pack fraction_of(Pack x) {
  return one_of(x, [](double l) { return std::isinf(l) ? 0.0 : l - std::nearbyint(l); });
}
inline Pack scaled(Pack x, Pack k) {
  Pack::count(kOther);
  for (int j = 0; j < kLanes; ++j) x.lane[j] *= std::exp2(k.lane[j]);
  return x;
}
inline Pack rough_reciprocal_root(Pack x) {
  // To as many bits as the instruction.
  return one_of(x, [](double l) { return 1.0 / std::sqrt(l) * (1.0 + 0x1p-15); });
}
#endif

}  // namespace sysid
