// Numbers that remember how they were computed, for derivatives of one result by very many inputs.
//
// A tape is a list of links y <- x, each with the partial derivative dy/dx, in the order in which they were made.
// Backwards, every link hands on what the result depends on: slope(x) += dy/dx slope(y). Lanes are those of packs.

#pragma once

#include <type_traits>
#include <vector>

#include "row.h"

namespace sysid {

class Tape;

// A number with its place on a tape; a constant has no tape, and the place 0.
struct Taped {
  Pack v;
  Tape* tape;
  int32_t at;
};
template <>
struct ScalarOf<Taped> {
  using type = Pack;
};
template <>
constexpr bool kRecorded<Taped> = true;
inline const Pack& value(const Taped& x) { return x.v; }

class Tape {
 public:
  Tape() { grow(); }

  // A new number, with slope zero.
  Taped number(const Pack& value) {
    if (places_ == static_cast<int32_t>(slope_.size())) grow();
    slope_[places_] = Pack{};
    return {value, this, places_++};
  }
  // A new number that depends on others, each followed by the partial derivative.
  template <class... Inputs>
  Taped depending(const Pack& value, const Inputs&... inputs) {
    const Taped found = number(value);
    write(links(sizeof...(inputs) / 2), found.at, inputs...);
    return found;
  }
  // A number from which nothing has been made depends on more.
  template <class... Inputs>
  void link(const Taped& result, const Inputs&... inputs) {
    write(links(sizeof...(inputs) / 2), result.at, inputs...);
  }
  Pack& slope(int32_t place) { return slope_[place]; }

  // Numbers that depend on others by a matrix (rows, columns): y += A x - less, where `less` may be null; `y` are numbers
  // that nothing has been made from. `matrix` has one number, or a pack, at every `stride` from row to row.
  template <class M>
  void product(const M* matrix, int stride, int rows, int columns, const Taped* x, Taped* y, const Taped* less) {
    const int64_t places = room(rows + columns + (less == nullptr ? 0 : rows));
    int32_t* place = &listed_[places];
    for (int j = 0; j < rows; ++j) *place++ = y[j].at;
    for (int k = 0; k < columns; ++k) *place++ = x[k].at;
    if (less != nullptr)
      for (int j = 0; j < rows; ++j) *place++ = less[j].at;
    operations_.push_back({count_, places, matrix, {}, rows, columns, stride,
                           std::is_same<M, Pack>::value ? kPacks : kNumbers, less != nullptr});
  }
  // n numbers that are the same sum of others: y_k = factor_1 x_1k + ...
  template <int terms>
  void sums(int n, const double (&factors)[terms], const Taped* const (&x)[terms], Taped* y) {
    const int64_t places = room((terms + 1) * n);
    int32_t* place = &listed_[places];
    for (int k = 0; k < n; ++k) *place++ = y[k].at;
    for (int t = 0; t < terms; ++t)
      for (int k = 0; k < n; ++k) *place++ = x[t][k].at;
    Operation done{count_, places, nullptr, {}, n, terms, 0, kSums, false};
    for (int t = 0; t < terms; ++t) done.factors[t] = factors[t];
    operations_.push_back(done);
  }

  // How far the tape is written.
  struct Mark {
    int32_t places;
    int64_t links, operations, listed;
  };
  Mark mark() const { return {places_, count_, static_cast<int64_t>(operations_.size()), list_count_}; }
  // Goes back to a mark: slopes of what was there before are complete, and what came after is forgotten.
  void back(const Mark& to) {
    int64_t after = count_;
    while (static_cast<int64_t>(operations_.size()) > to.operations) {
      const Operation& done = operations_.back();
      back_along_links(done.links, after);
      after = done.links;
      back_through(done);
      operations_.pop_back();
    }
    back_along_links(to.links, after);
    count_ = to.links;
    places_ = to.places;
    list_count_ = to.listed;
  }
  // Slopes of all numbers are complete then.
  void back_to_start() { back({places_, 0, 0, 0}); }

 private:
  struct Ends {
    int32_t result, input;
  };
  enum Kind : int32_t { kNumbers, kPacks, kSums };
  // What many numbers have to do with many others, between links; their places are listed from `places` on.
  struct Operation {
    int64_t links, places;
    const void* matrix;
    double factors[5];
    int32_t rows, columns, stride;
    Kind kind;
    bool less;
  };

  void back_along_links(int64_t from, int64_t to) {
    Pack* slope = slope_.data();
    const Pack* partial = partial_.data();
    const Ends* ends = ends_.data();
    // The slope of a result is complete when the first of its links is met, and stays in a register for the others.
    int32_t result = 0;
    Pack of_result{};
    for (int64_t k = to - 1; k >= from; --k) {
      if (ends[k].result != result) result = ends[k].result, of_result = slope[result];
      slope[ends[k].input] += partial[k] * of_result;
    }
  }

  void back_through(const Operation& done) {
    const int32_t *y = &listed_[done.places], *x = y + done.rows;
    if (done.kind == kSums) {
      for (int t = 0; t < done.columns; ++t, x += done.rows)
        for (int k = 0; k < done.rows; ++k) slope_[x[k]] += done.factors[t] * slope_[y[k]];
    } else if (done.kind == kNumbers) {
      back_through(done, static_cast<const double*>(done.matrix), y, x);
    } else {
      back_through(done, static_cast<const Pack*>(done.matrix), y, x);
    }
  }
  template <class M>
  void back_through(const Operation& done, const M* matrix, const int32_t* y, const int32_t* x) {
    for (int k = 0; k < done.columns; ++k) {
      Pack sum = slope_[x[k]];
      for (int j = 0; j < done.rows; ++j) sum += matrix[j * done.stride + k] * slope_[y[j]];
      slope_[x[k]] = sum;
    }
    for (int j = 0; done.less && j < done.rows; ++j) slope_[x[done.columns + j]] -= slope_[y[j]];
  }

  // Room for more places in the list; the first of them.
  int64_t room(int more) {
    const int64_t first = list_count_;
    list_count_ += more;
    if (list_count_ > static_cast<int64_t>(listed_.size())) listed_.resize(2 * list_count_);
    return first;
  }

  // Room for more links; the first of them.
  int64_t links(int64_t more) {
    const int64_t first = count_;
    if (__builtin_expect(first + more > static_cast<int64_t>(ends_.size()), 0)) grow();
    count_ = first + more;
    return first;
  }
  void write(int64_t, int32_t) {}
  template <class... Rest>
  __attribute__((always_inline)) void write(int64_t at, int32_t result, const Taped& input, const Pack& partial,
                                            const Rest&... rest) {
    partial_[at] = partial;
    ends_[at] = {result, input.at};
    write(at + 1, result, rest...);
  }
  __attribute__((noinline)) void grow() {
    slope_.resize(2 * slope_.size() + 256);
    partial_.resize(2 * partial_.size() + 256);
    ends_.resize(partial_.size());
  }

  std::vector<Pack> slope_, partial_;
  std::vector<Ends> ends_;
  int32_t places_ = 1;  // the first is where constants are
  int64_t count_ = 0, list_count_ = 0;
  std::vector<Operation> operations_;
  std::vector<int32_t> listed_;
};

constexpr Pack kOne = Pack{} + 1.0, kMinusOne = Pack{} - 1.0;

// The value of a function of x, or of x and y, from its partial derivatives.
inline Taped depends(const Pack& value, const Taped& x, const Pack& by_x) {
  if (x.tape == nullptr) return {value, nullptr, 0};
  return x.tape->depending(value, x, by_x);
}
inline Taped depends(const Pack& value, const Taped& x, const Pack& by_x, const Taped& y, const Pack& by_y) {
  Tape* tape = x.tape != nullptr ? x.tape : y.tape;
  if (tape == nullptr) return {value, nullptr, 0};
  return tape->depending(value, x, by_x, y, by_y);
}

inline Taped operator+(const Taped& a, const Taped& b) {
  if (b.tape == nullptr) return {a.v + b.v, a.tape, a.at};
  return depends(a.v + b.v, a, kOne, b, kOne);
}
inline Taped operator-(const Taped& a, const Taped& b) { return depends(a.v - b.v, a, kOne, b, kMinusOne); }
inline Taped operator-(const Taped& a) { return depends(-a.v, a, kMinusOne); }
inline Taped operator*(const Taped& a, const Taped& b) { return depends(a.v * b.v, a, b.v, b, a.v); }
inline Taped operator/(const Taped& a, const Taped& b) {
  const Pack inverse = 1.0 / b.v, ratio = a.v * inverse;
  return depends(ratio, a, inverse, b, -ratio * inverse);
}
inline Taped operator+(const Pack& a, const Taped& b) { return {a + b.v, b.tape, b.at}; }
inline Taped operator+(double a, const Taped& b) { return {a + b.v, b.tape, b.at}; }
inline Taped operator+(const Taped& a, const Pack& b) { return {a.v + b, a.tape, a.at}; }
inline Taped operator*(const Pack& a, const Taped& b) { return depends(a * b.v, b, a); }
inline Taped operator*(double a, const Taped& b) { return splat(a) * b; }
inline Taped& operator+=(Taped& a, const Taped& b) { return a = a + b; }

// sum += a x. The sum stays at its place: nothing else may have been made from it, or be the same number.
__attribute__((always_inline)) inline void accumulate(Taped& sum, const Pack& a, const Taped& x) {
  const Pack v = sum.v + a * x.v;
  if (sum.tape == nullptr) {
    sum = depends(v, x, a);
  } else {
    sum.v = v;
    sum.tape->link(sum, x, a);
  }
}
inline void accumulate(Taped& sum, double a, const Taped& x) {
  if (a != 0.0) accumulate(sum, splat(a), x);
}

// sum += a b, likewise.
inline void add_product(Taped& sum, const Taped& a, const Taped& b) {
  if (sum.tape == nullptr) {
    sum += a * b;
  } else {
    sum.v += a.v * b.v;
    sum.tape->link(sum, a, b.v, b, a.v);
  }
}

inline Taped select(Mask where, const Taped& yes, const Taped& no) {
  if (!any(where)) return no;
  if (!any(~where)) return yes;
  return depends(select(where, yes.v, no.v), yes, select(where, kOne, Pack{}), no, select(where, Pack{}, kOne));
}
inline void clear(Mask where, Taped& x) { x = select(where, Taped{}, x); }
// The derivative of `positive`.
inline Pack where_positive(const Pack& x) { return select(x <= 0.0, Pack{}, kOne); }
inline Taped positive(const Taped& x) {
  if (!any(x.v <= 0.0)) return x;
  return depends(positive(x.v), x, where_positive(x.v));
}
inline Taped absolute(const Taped& x) { return depends(absolute(x.v), x, sign_of(x.v)); }
inline Taped reciprocal(const Taped& x) {
  const Pack inverse = 1.0 / x.v;
  return depends(inverse, x, -inverse * inverse);
}
inline Taped reciprocal_root(const Taped& x) {
  const Pack found = reciprocal_root(x.v);
  return depends(found, x, -0.5 * found * found * found);
}

template <>
inline Taped constant_row<Taped>(Pack x) {
  return {x, nullptr, 0};
}

}  // namespace sysid
