// The native engine's likelihood without Python: the limit of what a caller can reach.
//
//   bare FILE...
//
// Each FILE is one call of the engine's entry point `misfits`.  A line "FILE-NUMBER REPEATS" on standard input computes
// it so many times; the answer is a line "wall seconds, processor seconds, sum of the misfits", and, of the build that
// counts, the operations: additions, multiplications, divisions, roots, others, of parameter sets
// and of the road, and how many sets are in a pack.
// SYSID_THREADS sets the number of threads.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

#include "engine.cpp"

namespace {

struct Call {
  std::vector<std::vector<int64_t>> shapes;
  std::vector<std::vector<double>> values;
  std::vector<sysid::Array> arrays;
  std::vector<double> squares, products;
  std::vector<int64_t> deflection_axles, acceleration_axles;
  sysid::Settings settings;
};

template <class T>
std::vector<T> read(std::ifstream& in) {
  int64_t count = 0;
  in.read(reinterpret_cast<char*>(&count), sizeof count);
  std::vector<T> values(count);
  in.read(reinterpret_cast<char*>(values.data()), count * sizeof(T));
  return values;
}

// Integers, reals, both lists of axles, then shape and values of every buffer (see bare_kernel.py).
Call load(const char* path) {
  std::ifstream in(path, std::ios::binary);
  Call call;
  const auto integers = read<int64_t>(in);
  const auto reals = read<double>(in);
  call.deflection_axles = read<int64_t>(in);
  call.acceleration_axles = read<int64_t>(in);
  sysid::Settings& s = call.settings;
  s.samples = integers[0], s.substeps = integers[1], s.elements = integers[2];
  s.ramps = integers[3], s.stops = integers[4], s.rate_ramps = integers[5];
  s.interval = reals[0];
  for (int64_t k = 0; k < integers[6]; ++k) {
    call.shapes.push_back(read<int64_t>(in));
    call.values.push_back(read<double>(in));
    const auto& shape = call.shapes.back();
    // Vectors that move keep their numbers where they are.
    call.arrays.push_back({call.values.back().data(), shape.data(), static_cast<int64_t>(shape.size())});
  }
  const auto& laws = call.shapes[sysid::kLaws];
  call.squares.resize(laws[1] * laws[3]);
  call.products.resize(call.arrays.back().shape[2] * call.squares.size());
  s.deflection_axles = {call.deflection_axles.data(), static_cast<int64_t>(call.deflection_axles.size())};
  s.acceleration_axles = {call.acceleration_axles.data(), static_cast<int64_t>(call.acceleration_axles.size())};
  if (!in) std::cerr << "incomplete file " << path << "\n";
  return call;
}

double processor_seconds() {
  timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

int main(int count, char** names) {
  if (const char* threads = std::getenv("SYSID_THREADS")) sysid_use_threads(std::atoi(threads));
  std::vector<Call> calls;
  for (int k = 1; k < count; ++k) calls.push_back(load(names[k]));
  std::string line;
  while (std::getline(std::cin, line)) {
    size_t which = 0;
    int repeats = 0;
    std::istringstream(line) >> which >> repeats;
    if (which >= calls.size()) return 1;
    Call& call = calls[which];
    const double processor = processor_seconds();
    const auto start = std::chrono::steady_clock::now();
    for (int k = 0; k < repeats; ++k) {
      double* results[] = {call.squares.data(), call.products.data()};
      if (sysid_misfits(call.arrays.data(), call.arrays.size(), &call.settings, results) != nullptr) return 1;
    }
    const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    double sum = 0.0;
    for (const double x : call.squares) sum += x;
    std::printf("%.9e %.9e %.17e", wall, processor_seconds() - processor, sum);
#ifdef SYSID_COUNTED
    for (sysid::Count& kind : sysid::counted) {
      for (const uint64_t of : kind.of) std::printf(" %llu", static_cast<unsigned long long>(of));
      kind = {};
    }
    std::printf(" %d", sysid::kLanes);
#endif
    std::printf("\n");
    std::fflush(stdout);
  }
}
