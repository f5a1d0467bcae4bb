// Entry point of the native engine for misfits with their derivatives.

#include "call.h"
#include "gradient.h"

namespace sysid {
namespace {

// A row of kLaws or kFrames on a tape: which array, row, axle or frame, how many of these there are, and the place.
struct Row {
  int array;
  int64_t row, of, width;
  int32_t place;
};

// Laws of a pack on a tape; `rows` gets where the rows of kLaws and kFrames are there.
Laws<Taped> taped_laws(const Inputs& in, const Lanes& lanes, Tape& tape, std::vector<Row>& rows) {
  const auto input = [&](int which, int64_t row, int64_t i, int64_t width) {
    const Taped x = tape.number(in.pack(lanes, which, row, i, width));
    rows.push_back({which, row, i, width, x.at});
    return x;
  };
  Laws<Taped> found = in.read<Taped>([&](int64_t row, int64_t i) { return input(kLaws, row, i, in.axles); },
                                     [&](int64_t row, int64_t i) { return in.pack(lanes, kSides, row, i, in.axles); },
                                     [&](int64_t i) { return in.reference_load(lanes, i); }, MotionChange<Taped>{});
  for (int64_t f = 0; f < in.frames; ++f) {
    found.frame_stiffness.push_back(input(kFrames, 0, f, in.frames));
    found.frame_damping.push_back(input(kFrames, 1, f, in.frames));
  }
  return found;
}

// Misfit and its derivatives of the runs and sets of a pack.
template <int NB, bool Filtered, class M>
void go_back(const Inputs& in, const Run<M>& run, const Readings<M>& readings, const LocalColumns<M>& columns,
             const Lanes& lanes, double* const* out) {
  const int channels = in.channels.count();
  const int64_t samples = in.clock.samples;
  const std::unique_ptr<Pack[]> signal(new Pack[samples * channels]), slopes(new Pack[samples * channels]);  // (C, T)
  KeptStates<NB> kept(in.clock.steps(), run.axles);
  integrate<Pack, M, NB, Filtered>(
      run, in.laws(lanes), in.channels, in.filter, in.clock,
      [&](int64_t t, const auto&, const auto&, const Pack* shown) {
        for (int64_t c = 0; c < channels; ++c) signal[c * samples + t] = shown[c];
      },
      [&](int64_t step, const auto& state, const auto& resting) { kept.keep(step, state, resting, run.axles); });
  Pack pull[kMotionNumbers];
  const Pack found = misfit(readings, columns, signal.get(), channels, pull);
  for (int c = 0; c < channels; ++c)
    slopes_by_signal(readings, columns, signal.get() + c * samples, c, channels, pull, slopes.get() + c * samples);
  store(found, out[kGradientsMisfit], 1, 0, lanes, in.sets);
  Tape tape;
  std::vector<Row> rows;
  const Laws<Taped> laws = taped_laws(in, lanes, tape, rows);
  follow_back<M, NB, Filtered>(run, laws, tape, in.channels, in.filter, in.clock, kept, slopes.get());
  for (const Row& row : rows) {
    double* to = out[row.array == kLaws ? kGradientsLawSlopes : kGradientsFrameSlopes];
    store(tape.slope(row.place), to + row.row * in.runs * row.width * in.sets, row.width, row.of, lanes, in.sets);
  }
}

// With the number of body coordinates known to the compiler; false if it is not compiled for it.
template <int NB = kFewest, class M, class... Others>
bool go_back_of_size(const Inputs& in, const Run<M>& run, const Others&... others) {
  if constexpr (NB > kMost) {
    return false;
  } else if (in.coordinates != NB) {
    return go_back_of_size<NB + 1>(in, run, others...);
  } else {
    if (in.filter.pole.empty())
      go_back<NB, false>(in, run, others...);
    else
      go_back<NB, true>(in, run, others...);
    return true;
  }
}

// Misfit (R, S) and its derivatives by the rows of the laws (L, R, na, S) and of the frames (2, R, nf, S).
Problem gradients(const Inputs& in, double* const* out) {
  const Measured measured(in, kGradientsReadings, kGradientsLocal);
  const std::vector<Lanes> packs = in.packs();
  std::atomic<bool> known{true};
  share(packs.size(), [&](int64_t task) {
    const Lanes& lanes = packs[task];
    if (in.sets > 1) {
      const int64_t r = lanes.run[0];
      known = go_back_of_size(in, in.run(r), measured.readings[r], measured.columns[r], lanes, out);
    } else {
      std::vector<std::vector<Pack>> numbers;
      known = go_back_of_size(in, in.runs_of(lanes, numbers), measured.readings_of(lanes), measured.columns_of(lanes),
                              lanes, out);
    }
  });
  return finish(known);
}

}  // namespace
}  // namespace sysid

SYSID_ENTRY(gradients, kGradientsCount)
