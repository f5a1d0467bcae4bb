// The few names of XLA's interface that the native engine uses, over plain arrays: the engine's own sources, compiled
// against this header, run without Python and XLA.

#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace xla::ffi {

struct F64 {};

template <class T>
class Span {
 public:
  Span() = default;
  Span(const T* data, size_t size) : data_(data), size_(size) {}
  Span(const std::vector<std::remove_const_t<T>>& values) : Span(values.data(), values.size()) {}
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }
  size_t size() const { return size_; }
  const T& operator[](size_t k) const { return data_[k]; }

 private:
  const T* data_ = nullptr;
  size_t size_ = 0;
};

struct Array {
  std::vector<int64_t> shape;
  std::vector<double> values;
};

template <class Kind>
class Buffer {
 public:
  explicit Buffer(Array* array) : array_(array) {}
  double* typed_data() const { return array_->values.data(); }
  Span<const int64_t> dimensions() const { return {array_->shape.data(), array_->shape.size()}; }
  size_t element_count() const { return array_->values.size(); }

 private:
  Array* array_;
};

class Error {
 public:
  static Error Success() { return {}; }
  static Error InvalidArgument(std::string message) {
    Error error;
    error.message_ = std::move(message);
    return error;
  }
  const std::string& message() const { return message_; }

 private:
  std::string message_;
};

template <class T>
class ErrorOr {
 public:
  explicit ErrorOr(T value) : value_(value) {}
  bool has_value() const { return true; }
  Error error() const { return {}; }
  const T& operator*() const { return value_; }

 private:
  T value_;
};

class RemainingArgs {
 public:
  explicit RemainingArgs(std::vector<Array>* arrays) : arrays_(arrays) {}
  size_t size() const { return arrays_->size(); }
  template <class B>
  ErrorOr<B> get(size_t k) const {
    return ErrorOr<B>(B(&(*arrays_)[k]));
  }

 private:
  std::vector<Array>* arrays_;
};

class RemainingRets {
 public:
  explicit RemainingRets(std::vector<Array>* arrays) : arrays_(arrays) {}
  template <class B>
  class Result {
   public:
    explicit Result(B buffer) : buffer_(buffer) {}
    const B* operator->() const { return &buffer_; }

   private:
    B buffer_;
  };
  template <class B>
  ErrorOr<Result<B>> get(size_t k) const {
    return ErrorOr<Result<B>>(Result<B>(B(&(*arrays_)[k])));
  }

 private:
  std::vector<Array>* arrays_;
};

}  // namespace xla::ffi

#define XLA_FFI_REGISTER_STRUCT_ATTR_DECODING(...) static_assert(true)
#define XLA_FFI_DEFINE_HANDLER_SYMBOL(...) static_assert(true)
