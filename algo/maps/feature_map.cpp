#include "algo/maps/feature_map.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "algo/features/gradient.h"
#include "algo/features/row_window.h"
#include "algo/maps/row_thread_pool.h"
#include "algo/soa/soa_distances.h"

namespace hord::algo {
namespace {

// Rows per band, pairwise; each band decodes one row more at either end. All distances of a band are submitted before
// finish(), so that the solver can batch many problems of one shape.
constexpr int kBandRows = 16;

// A worker has one of the two: `soa` for the features it covers, else `pairwise`.
struct Worker {
    Worker(const Extents& e, Distance d, Isa isa) : pairwise(std::make_unique<Pairwise>(e, std::move(d), isa)) {}
    Worker(const Extents& e, Feature feature, Isa isa) : soa(std::make_unique<SoaDistances>(e, feature, isa)) {}

    struct Pairwise {
        Pairwise(const Extents& e, Distance d, Isa an_isa)
            : isa(an_isa), distance(std::move(d)), window(e, distance.compact(), isa), reference(e),
              gradients(static_cast<std::size_t>(kBandRows * e.m)) {}
        Isa isa;
        Distance distance;
        RowWindow window;
        HordRow reference;
        std::vector<EmdGradient> gradients;  // of the lenslets of a band; against a reference only x is used
        std::uint64_t at_limit = 0;

        template <class AnyHord>
        void submit(const AnyHord& a, const AnyHord& b, double* out, std::uint8_t& flags) {
            const std::uint64_t before = distance.saturated();
            distance.submit(a, b, out);
            if (distance.saturated() != before) flags |= kAtLimit;
        }
    };
    std::unique_ptr<Pairwise> pairwise;
    std::unique_ptr<SoaDistances> soa;
    int next_row = -1;  // the row after the last band it computed of this frame
};

}  // namespace

struct FeatureMapper::State {
    Extents extents;
    int bits = 8;
    LightLevels levels;
    Feature feature = Feature::emd;
    std::unique_ptr<RowThreadPool> pool;
    std::vector<Worker> workers;
    std::vector<float> values;
    std::vector<std::uint8_t> mask;

    template <class Band>
    FeatureMap in_bands(Band compute);
    void finish(Worker::Pairwise& worker, int first, int last);
    void neighbours_band(Worker::Pairwise& worker, const FrameView& frame, int first, int last, bool goes_on);
    void reference_band(Worker::Pairwise& worker, const FrameView& frame, const FrameView& reference, int first,
                        int last);
};

// Calls compute(worker, first row, row after the last, whether they follow the worker's previous rows) for all bands.
template <class Band>
FeatureMap FeatureMapper::State::in_bands(Band compute) {
    for (Worker& worker : workers) {
        worker.next_row = -1;
        if (worker.pairwise) worker.pairwise->at_limit = 0;
    }
    const int rows = workers[0].soa ? pool->rows_a_band(extents.n) : kBandRows;
    pool->share_out((extents.n + rows - 1) / rows, [&](int worker, int band) {
        Worker& w = workers[static_cast<std::size_t>(worker)];
        const int first = band * rows, last = std::min((band + 1) * rows, extents.n);
        const bool goes_on = std::exchange(w.next_row, last) == first;
        compute(w, first, last, goes_on);
    });
    FeatureMap map{values, mask, 0};
    for (const Worker& worker : workers) map.at_limit += worker.pairwise ? worker.pairwise->at_limit : 0;
    return map;
}

// Writes the values of rows first .. last-1, which have been submitted.
void FeatureMapper::State::finish(Worker::Pairwise& worker, int first, int last) {
    worker.distance.finish();
    const std::size_t from = extents.index(0, first), count = extents.index(0, last) - from;
    for (std::size_t k = 0; k < count; ++k) {
        values[from + k] = static_cast<float>(worker.gradients[k].norm());
        worker.at_limit += (mask[from + k] & kAtLimit) != 0 ? 1U : 0U;
    }
}

void FeatureMapper::State::neighbours_band(Worker::Pairwise& worker, const FrameView& frame, int first, int last,
                                           bool goes_on) {
    RowWindow& window = worker.window;
    window.stream(frame, levels, first, last, goes_on, [&](int n) {
        for (int m = 0; m < extents.m; ++m) {
            const auto near = window.neighbours(m, n);
            const std::size_t k = extents.index(m, n);
            EmdGradient& gradient = worker.gradients[k - extents.index(0, first)];
            gradient = {};
            std::uint8_t flags = near.mask;
            if ((near.mask & kNoGradient) == 0) {
                gradient.weight_x = near.across.weight();
                gradient.weight_y = near.down.weight();
                worker.submit(window.sparse(near.left, n), window.sparse(near.right, n), &gradient.x, flags);
                worker.submit(window.sparse(m, near.above), window.sparse(m, near.below), &gradient.y, flags);
            }
            mask[k] = flags;
        }
    });
    finish(worker, first, last);
}

void FeatureMapper::State::reference_band(Worker::Pairwise& worker, const FrameView& frame, const FrameView& reference,
                                          int first, int last) {
    HordRow& expected = worker.reference;
    for (int n = first; n < last; ++n) {
        const HordRow& row = worker.window.decode(frame, levels, n);
        decode_row(reference, extents, levels, n, expected, worker.isa);
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = extents.index(m, n);
            EmdGradient& difference = worker.gradients[k - extents.index(0, first)];
            difference = {0, 0, 1, 0};
            std::uint8_t flags = row.mask()[static_cast<std::size_t>(m)];
            if (!expected.has_hord(m)) flags |= kBorder;
            if ((flags & kNoGradient) == 0) worker.submit(row.hord(m), expected.hord(m), &difference.x, flags);
            mask[k] = flags;
        }
    }
    finish(worker, first, last);
}

Result<FeatureMapper> FeatureMapper::create(const Extents& extents, int bits, const LightLevels& levels,
                                            Feature feature, const Options& options) {
    if (auto valid = check(extents); !valid) return tl::unexpected(valid.error());
    if (auto valid = check_bits(bits); !valid) return tl::unexpected(valid.error());
    if (feature == Feature::transmission) {
        return fail(ErrorCode::invalid_argument, "transmission compares a lenslet with the whole part",
                    "take it from an inspection");
    }
    if (!has(options.isa))
        return fail(ErrorCode::unsupported, "an instruction set that this processor does not have", "use best_isa()");
    auto pool = RowThreadPool::create(options.threads);
    if (!pool) return tl::unexpected(pool.error());
    auto state = common::make_opaque<State>();
    state->extents = extents;
    state->bits = bits;
    state->levels = levels;
    state->feature = feature;
    state->pool = std::move(*pool);
    const bool soa = SoaDistances::covers(feature) && (options.distance.directions.empty() || !is_distance(feature));
    for (int worker = 0; worker < options.threads; ++worker) {
        if (soa) {
            state->workers.emplace_back(extents, feature, options.isa);
            continue;
        }
        auto distance = Distance::create(feature, extents.i, extents.j, options.distance, options.isa);
        if (!distance) return tl::unexpected(distance.error());
        state->workers.emplace_back(extents, std::move(*distance), options.isa);
    }
    state->values.resize(extents.lenslets());
    state->mask.resize(extents.lenslets());
    return FeatureMapper(std::move(state));
}

Result<FeatureMap> FeatureMapper::over_neighbours(const FrameView& frame) {
    State& s = *state_;
    if (auto valid = check_frame(frame, s.extents, s.bits); !valid) return tl::unexpected(valid.error());
    return s.in_bands([&](Worker& worker, int first, int last, bool goes_on) {
        if (worker.soa) {
            worker.soa->over_neighbours(frame, s.levels, first, last, s.values.data(), s.mask.data(), goes_on);
        } else {
            s.neighbours_band(*worker.pairwise, frame, first, last, goes_on);
        }
    });
}

Result<FeatureMap> FeatureMapper::against(const FrameView& frame, const FrameView& reference) {
    State& s = *state_;
    for (const FrameView& view : {frame, reference}) {
        if (auto valid = check_frame(view, s.extents, s.bits); !valid) return tl::unexpected(valid.error());
    }
    if (!is_distance(s.feature)) {
        return fail(ErrorCode::invalid_argument, std::string(name_of(s.feature)) + " compares neighbours",
                    "give a distance to compare with a reference");
    }
    return s.in_bands([&](Worker& worker, int first, int last, bool /*goes_on*/) {
        if (worker.soa)
            return worker.soa->against(frame, reference, s.levels, first, last, s.values.data(), s.mask.data());
        s.reference_band(*worker.pairwise, frame, reference, first, last);
    });
}

}  // namespace hord::algo
