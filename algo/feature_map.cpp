#include "algo/feature_map.h"

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "algo/bands.h"
#include "algo/gradient.h"
#include "algo/jacobian.h"
#include "algo/row_window.h"

namespace hord::algo {
namespace {

// Rows a band has; it decodes one row more at either end. The distances of a band are asked for before they are finished, so that
// the solver finds many small problems alike.
constexpr int kBandRows = 16;

struct Worker {
    Worker(const Extents& e, bool jacobian, std::optional<Distance> d)
        : window(e, jacobian), reference(e), distance(std::move(d)), asked(static_cast<std::size_t>(kBandRows * e.m)) {}
    RowWindow window;
    HordRow reference;
    std::optional<Distance> distance;
    std::vector<EmdGradient> asked;  // of a band's lenslets; against a reference x alone is used
    std::uint64_t at_limit = 0;
};

float value_of(Feature feature, const Jacobian& jacobian) {
    switch (feature) {
        case Feature::jacobian_spectral: return singular_norms(jacobian).spectral.to_float_rounded();
        case Feature::jacobian_nuclear: return singular_norms(jacobian).nuclear.to_float_rounded();
        case Feature::anisotropy: return singular_norms(jacobian).anisotropy.to_float_rounded();
        default: return frobenius_norm(jacobian).to_float_rounded();
    }
}

}  // namespace

struct FeatureMapper::State {
    Extents extents;
    int bits = 8;
    LightLevels levels;
    Feature feature = Feature::emd;
    std::unique_ptr<BandCrew> crew;
    std::vector<Worker> workers;
    std::vector<float> values;
    std::vector<std::uint8_t> mask;

    [[nodiscard]] std::size_t at(int m, int n) const { return static_cast<std::size_t>(n) * static_cast<std::size_t>(extents.m) + static_cast<std::size_t>(m); }

    template <class Band>
    FeatureMap in_bands(Band compute);
    void submit(Worker& worker, const Hord& a, const Hord& b, double* out, std::uint8_t& flags);
    void finish(Worker& worker, int first, int last);
    void neighbours_band(Worker& worker, const FrameView& frame, int first, int last);
    template <class ReferenceRow>
    void reference_band(Worker& worker, const FrameView& frame, ReferenceRow reference_row, int first, int last);
    [[nodiscard]] Result<void> check_reference() const;
};

// Shares the rows out; the result does not depend on how.
template <class Band>
FeatureMap FeatureMapper::State::in_bands(Band compute) {
    for (Worker& worker : workers) worker.at_limit = 0;
    crew->share_out((extents.n + kBandRows - 1) / kBandRows, [&](int worker, int band) {
        compute(workers[static_cast<std::size_t>(worker)], band * kBandRows, std::min((band + 1) * kBandRows, extents.n));
    });
    FeatureMap map{values, mask, 0};
    for (const Worker& worker : workers) map.at_limit += worker.at_limit;
    return map;
}

void FeatureMapper::State::submit(Worker& worker, const Hord& a, const Hord& b, double* out, std::uint8_t& flags) {
    const std::uint64_t before = worker.distance->saturated();
    worker.distance->submit(a, b, out);
    if (worker.distance->saturated() != before) flags |= kAtLimit;
}

// Writes the values of rows first .. last-1, which have been asked for.
void FeatureMapper::State::finish(Worker& worker, int first, int last) {
    worker.distance->finish();
    const std::size_t from = at(0, first), count = at(0, last) - from;
    for (std::size_t k = 0; k < count; ++k) {
        values[from + k] = static_cast<float>(worker.asked[k].norm());
        worker.at_limit += (mask[from + k] & kAtLimit) != 0 ? 1U : 0U;
    }
}

void FeatureMapper::State::neighbours_band(Worker& worker, const FrameView& frame, int first, int last) {
    RowWindow& window = worker.window;
    window.stream(frame, levels, first, last, [&](int n) {
        for (int m = 0; m < extents.m; ++m) {
            const auto near = window.neighbours(m, n);
            const std::size_t k = at(m, n);
            std::uint8_t flags = near.mask;
            const bool has_value = (near.mask & kNoGradient) == 0;
            if (worker.distance) {
                EmdGradient& gradient = worker.asked[k - at(0, first)];
                gradient = {};
                if (has_value) {
                    gradient.weight_x = near.across.weight();
                    gradient.weight_y = near.down.weight();
                    submit(worker, window.row(n).hord(near.left), window.row(n).hord(near.right), &gradient.x, flags);
                    submit(worker, window.row(near.above).hord(m), window.row(near.below).hord(m), &gradient.y, flags);
                }
            } else {
                Jacobian jacobian;
                if (has_value) {
                    jacobian = jacobian_of(near.across, window.deflection(near.left, n), window.deflection(near.right, n), near.down,
                                           window.deflection(m, near.above), window.deflection(m, near.below));
                }
                values[k] = value_of(feature, jacobian);
            }
            mask[k] = flags;
        }
    });
    if (worker.distance) finish(worker, first, last);
}

// reference_row(n) returns a function that gives the reference's HORD in column m.
template <class ReferenceRow>
void FeatureMapper::State::reference_band(Worker& worker, const FrameView& frame, ReferenceRow reference_row, int first, int last) {
    for (int n = first; n < last; ++n) {
        const HordRow& row = worker.window.decode(frame, levels, n);
        const auto reference = reference_row(n);
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = at(m, n);
            EmdGradient& difference = worker.asked[k - at(0, first)];
            difference = {0, 0, 1, 0};
            std::uint8_t flags = row.mask()[static_cast<std::size_t>(m)];
            const Hord wanted = reference(m);
            if (wanted.sum == 0) flags |= kBorder;
            if ((flags & kNoGradient) == 0) submit(worker, row.hord(m), wanted, &difference.x, flags);
            mask[k] = flags;
        }
    }
    finish(worker, first, last);
}

Result<void> FeatureMapper::State::check_reference() const {
    if (is_distance(feature)) return {};
    return fail(ErrorCode::invalid_argument, std::string(name_of(feature)) + " compares neighbours", "give a distance to compare with a reference");
}

Result<FeatureMapper> FeatureMapper::create(const Extents& extents, int bits, const LightLevels& levels, Feature feature, const Options& options) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_bits(bits); !fine) return tl::unexpected(fine.error());
    if (feature == Feature::transmission) {
        return fail(ErrorCode::invalid_argument, "transmission compares a lenslet with the whole part", "take it from an inspection");
    }
    auto crew = BandCrew::create(options.threads);
    if (!crew) return tl::unexpected(crew.error());
    auto state = std::make_unique<State>();
    state->extents = extents;
    state->bits = bits;
    state->levels = levels;
    state->feature = feature;
    state->crew = std::move(*crew);
    for (int worker = 0; worker < options.threads; ++worker) {
        std::optional<Distance> distance;
        if (is_distance(feature)) {
            auto made = Distance::create(feature, extents.i, extents.j, options.distance);
            if (!made) return tl::unexpected(made.error());
            distance.emplace(std::move(*made));
        }
        state->workers.emplace_back(extents, !is_distance(feature), std::move(distance));
    }
    state->values.resize(extents.lenslets());
    state->mask.resize(extents.lenslets());
    return FeatureMapper(std::move(state));
}

Result<FeatureMap> FeatureMapper::over_neighbours(const FrameView& frame) {
    State& s = *state_;
    if (auto fine = check_frame(frame, s.extents, s.bits); !fine) return tl::unexpected(fine.error());
    return s.in_bands([&](Worker& worker, int first, int last) { s.neighbours_band(worker, frame, first, last); });
}

Result<FeatureMap> FeatureMapper::against(const FrameView& frame, const FrameView& reference) {
    State& s = *state_;
    for (const FrameView& view : {frame, reference}) {
        if (auto fine = check_frame(view, s.extents, s.bits); !fine) return tl::unexpected(fine.error());
    }
    if (auto fine = s.check_reference(); !fine) return tl::unexpected(fine.error());
    return s.in_bands([&](Worker& worker, int first, int last) {
        const auto decoded = [&](int n) {
            decode_row(reference, s.extents, s.levels, n, worker.reference);
            return [&row = worker.reference](int m) { return row.has_hord(m) ? row.hord(m) : Hord{}; };
        };
        s.reference_band(worker, frame, decoded, first, last);
    });
}

Result<FeatureMap> FeatureMapper::against(const FrameView& frame, std::span<const Hord> reference) {
    State& s = *state_;
    if (auto fine = check_frame(frame, s.extents, s.bits); !fine) return tl::unexpected(fine.error());
    if (auto fine = s.check_reference(); !fine) return tl::unexpected(fine.error());
    if (reference.size() != s.extents.lenslets()) {
        return fail(ErrorCode::invalid_argument, std::to_string(reference.size()) + " reference HORDs", "give one a lenslet: " + std::to_string(s.extents.lenslets()));
    }
    return s.in_bands([&](Worker& worker, int first, int last) {
        const auto given = [&](int n) { return [row = reference.subspan(s.at(0, n))](int m) { return row[static_cast<std::size_t>(m)]; }; };
        s.reference_band(worker, frame, given, first, last);
    });
}

FeatureMapper::FeatureMapper(std::unique_ptr<State> state) : state_(std::move(state)) {}
FeatureMapper::FeatureMapper(FeatureMapper&&) noexcept = default;
FeatureMapper& FeatureMapper::operator=(FeatureMapper&&) noexcept = default;
FeatureMapper::~FeatureMapper() = default;

}  // namespace hord::algo
