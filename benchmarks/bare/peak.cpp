// How many floating-point operations per second this machine's cores can do at most, by loops of fused multiply-adds.
//
//   peak THREADS
//
// prints "lanes GF/s-of-a-core GF/s-of-all nanoseconds-of-a-dependent-one" for packs of 4 and of 8 lanes where the
// processor has them: the first by the processor time of the threads, the second by wall time.

#include <immintrin.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <thread>
#include <vector>

namespace {

constexpr int kChains = 12;  // independent sums: more than latency times units, and fewer than registers
constexpr long kRounds = 8'000'000;

typedef double Four __attribute__((vector_size(32)));
typedef double Eight __attribute__((vector_size(64)));

// In one block of assembly: the compiler would keep an array of sums in memory.
#define SYSID_FMA(k) "vfmadd213pd %[term], %[factor], %" #k "\n"

double thread_seconds() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Seconds of processor time of kRounds rounds of kChains independent multiply-adds.
template <class V>
double seconds_of_all() {
  const V one = V{} + 1.0, factor = V{} + 0.999999, term = V{} + 1e-9;
  V a = one, b = one, c = one, d = one, e = one, f = one, g = one, h = one, i = one, j = one, k = one, l = one;
  const double begin = thread_seconds();
  for (long round = 0; round < kRounds; ++round)
    asm volatile(SYSID_FMA(0) SYSID_FMA(1) SYSID_FMA(2) SYSID_FMA(3) SYSID_FMA(4) SYSID_FMA(5) SYSID_FMA(6)
                     SYSID_FMA(7) SYSID_FMA(8) SYSID_FMA(9) SYSID_FMA(10) SYSID_FMA(11)
                 : "+x"(a), "+x"(b), "+x"(c), "+x"(d), "+x"(e), "+x"(f), "+x"(g), "+x"(h), "+x"(i), "+x"(j), "+x"(k),
                   "+x"(l)
                 : [factor] "x"(factor), [term] "x"(term));
  return thread_seconds() - begin;
}

// The same of one, each waiting for the one before.
template <class V>
double seconds_of_one() {
  const V factor = V{} + 0.999999, term = V{} + 1e-9;
  V a = V{} + 1.0;
  const double begin = thread_seconds();
  for (long round = 0; round < kRounds; ++round)
    asm volatile(SYSID_FMA(0) : "+x"(a) : [factor] "x"(factor), [term] "x"(term));
  return thread_seconds() - begin;
}

template <class V>
void report(int threads) {
  constexpr int lanes = sizeof(V) / sizeof(double);
  constexpr double work = 2.0 * lanes * kChains * kRounds;
  std::vector<double> used(threads);
  const auto begin = std::chrono::steady_clock::now();
  std::vector<std::thread> others;
  for (int k = 0; k < threads; ++k) others.emplace_back([&used, k] { used[k] = seconds_of_all<V>(); });
  for (std::thread& other : others) other.join();
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  double sum = 0.0;
  for (const double u : used) sum += u;
  const double latency = seconds_of_one<V>() / kRounds;
  std::printf("%d %.4g %.4g %.4g\n", lanes, 1e-9 * work * threads / sum, 1e-9 * work * threads / wall, 1e9 * latency);
}

}  // namespace

int main(int count, char** arguments) {
  const int threads = count > 1 ? std::atoi(arguments[1]) : 1;
#if defined(__AVX2__) && defined(__FMA__)
  report<Four>(threads);
#endif
#if defined(__AVX512F__)
  report<Eight>(threads);
#endif
}
