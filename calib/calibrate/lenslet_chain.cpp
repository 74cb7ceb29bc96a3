#include "calib/calibrate/lenslet_chain.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

constexpr double kMinMatch = 0.5;       // correlation with the profile of the frame's lenslets
constexpr double kMinAmplitude = 0.08;  // of the typical lenslet
constexpr double kMaxMiss = 0.25;       // pitches: distance of a lenslet from its prediction
constexpr double kMaxTear = 0.3;        // pitches: error of the step between two neighbours
constexpr double kMargin = 0.6;         // of the lattice's range: barrel distortion packs more lenslets into the frame
constexpr int kNear = 2;                // columns and rows about a lenslet from which it is predicted
constexpr double kFarWeight = 0.4;      // of lenslets two columns or rows away, against 1
constexpr double kStiffness = 0.5;      // pitches^2: weight of the slope that the neighbours were predicted with
constexpr double kOtherSize = 0.025;    // of the local pitch: from here on, lenslets have a profile of their own
constexpr std::size_t kMinOfSize = 12, kMaxOfSize = 80;  // lenslets from which a profile is learned
constexpr std::size_t kSearched = 4000;                  // of the last lenslets, for some of one size
constexpr int kMaxTries = 3, kMoreNeighbours = 3;  // a lenslet is tried again when it has that many more neighbours

struct Vector {
    double x = 0, y = 0;
};

// A lenslet's distance from its place by the lattice's steps, and how this distance changes a pitch along x and y.
struct Node {
    int m = 0, n = 0;
    Vector ideal, off = {}, by_x = {}, by_y = {};
    double light_dn = 0;
};

enum State : std::int32_t { kUnknown = -1, kFailed = -2 };  // others: the index of the node

class Chains {
  public:
    Chains(const WhiteImage& image, LocalFinders& finders, const LensletGrid& steps, double pitch_px)
        : image_(image), finders_(finders), steps_(steps), pitch_(pitch_px) {
        const std::vector<LensletPlace> places = lenslets_inside(steps, steps);
        for (const LensletPlace& place : places) box_.include(place.m, place.n);
        nodes_.reserve(places.size() + places.size() / 8);
        const int more_m = 2 + static_cast<int>(kMargin / 2 * (box_.high_m - box_.low_m));
        const int more_n = 2 + static_cast<int>(kMargin / 2 * (box_.high_n - box_.low_n));
        box_ = {box_.low_m - more_m, box_.high_m + more_m, box_.low_n - more_n, box_.high_n + more_n};
        columns_ = box_.high_m - box_.low_m + 1;
        state_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(box_.high_n - box_.low_n + 1),
                      kUnknown);
        tries_.assign(state_.size(), 0);
        neighbours_.assign(state_.size(), 0);
        tried_with_.assign(state_.size(), 0);
    }

    // Starts a chain at a lenslet predicted at `at`, and follows it. False if there is no lenslet.
    bool start(int m, int n, PixelPoint at, Vector by_x = {}, Vector by_y = {}) {
        if (!contains(m, n) || state(m, n) >= 0) return false;
        const Node expected{.m = m, .n = n, .ideal = ideal(m, n), .by_x = by_x, .by_y = by_y};
        const auto seen = measure(finders_.at(scale_of(expected)), at);
        if (!seen) return false;
        add(m, n, *seen, by_x, by_y);
        for (; next_ < nodes_.size(); ++next_) {
            const int here_m = nodes_[next_].m, here_n = nodes_[next_].n;
            for (int dn = -1; dn <= 1; ++dn) {
                for (int dm = -1; dm <= 1; ++dm) {
                    if (dm != 0 || dn != 0) try_lenslet(here_m + dm, here_n + dn);
                }
            }
        }
        return true;
    }

    [[nodiscard]] std::size_t size() const { return nodes_.size(); }
    [[nodiscard]] const IndexRange& inside() const { return inside_; }

    // True if a lenslet within kNear columns and rows is measured: a chain has been there.
    [[nodiscard]] bool reached(int m, int n) const {
        for (int dn = -kNear; dn <= kNear; ++dn) {
            for (int dm = -kNear; dm <= kNear; ++dm) {
                if (contains(m + dm, n + dn) && state(m + dm, n + dn) >= 0) return true;
            }
        }
        return false;
    }

    // Row by row; of `every` lenslets one.
    [[nodiscard]] std::vector<Observation> observations(std::size_t every = 1) const {
        std::vector<Observation> out;
        out.reserve(nodes_.size() / every + 1);
        std::size_t measured = 0;
        for (const std::int32_t k : state_) {
            if (k < 0 || measured++ % every != 0) continue;
            const Node& node = nodes_[static_cast<std::size_t>(k)];
            out.push_back({.m = node.m,
                           .n = node.n,
                           .centre_px = {node.ideal.x + node.off.x, node.ideal.y + node.off.y},
                           .light_dn = node.light_dn});
        }
        return out;
    }

    // Lenslets that no chain joins to the largest group, and pairs of neighbours that are not one pitch apart.
    void check(int& apart, int& torn) const {
        std::vector<std::size_t> parent(nodes_.size());
        std::iota(parent.begin(), parent.end(), std::size_t{0});
        const auto root = [&](std::size_t k) {
            while (parent[k] != k) k = parent[k] = parent[parent[k]];
            return k;
        };
        std::vector<std::pair<std::size_t, std::size_t>> tears;
        for (std::size_t k = 0; k < nodes_.size(); ++k) {
            const Node& a = nodes_[k];
            for (const auto& [dm, dn] : {std::pair{1, 0}, {0, 1}, {1, 1}, {-1, 1}}) {
                if (!contains(a.m + dm, a.n + dn) || state(a.m + dm, a.n + dn) < 0) continue;
                const auto other = static_cast<std::size_t>(state(a.m + dm, a.n + dn));
                const Node& b = nodes_[other];
                const double x = (b.ideal.x - a.ideal.x) / pitch_, y = (b.ideal.y - a.ideal.y) / pitch_;
                const double miss_x = b.off.x - a.off.x - 0.5 * ((a.by_x.x + b.by_x.x) * x + (a.by_y.x + b.by_y.x) * y);
                const double miss_y = b.off.y - a.off.y - 0.5 * ((a.by_x.y + b.by_x.y) * x + (a.by_y.y + b.by_y.y) * y);
                if (miss_x * miss_x + miss_y * miss_y < kMaxTear * kMaxTear * pitch_ * pitch_)
                    parent[root(k)] = root(other);
                else tears.emplace_back(k, other);
            }
        }
        std::vector<int> members(nodes_.size());
        for (std::size_t k = 0; k < nodes_.size(); ++k) ++members[root(k)];
        const auto largest =
            static_cast<std::size_t>(std::max_element(members.begin(), members.end()) - members.begin());
        apart = static_cast<int>(nodes_.size()) - members[largest];
        torn = static_cast<int>(std::count_if(tears.begin(), tears.end(), [&](const auto& pair) {
            return root(pair.first) == largest && root(pair.second) == largest;
        }));
    }

  private:
    [[nodiscard]] bool contains(int m, int n) const {
        return m >= box_.low_m && m <= box_.high_m && n >= box_.low_n && n <= box_.high_n;
    }
    [[nodiscard]] std::size_t place(int m, int n) const {
        return static_cast<std::size_t>(n - box_.low_n) * static_cast<std::size_t>(columns_) +
            static_cast<std::size_t>(m - box_.low_m);
    }
    [[nodiscard]] std::int32_t state(int m, int n) const { return state_[place(m, n)]; }
    [[nodiscard]] Vector ideal(int m, int n) const {
        const PixelPoint at = steps_.at(steps_.uv(m, n));
        return {at.x_px, at.y_px};
    }

    // The local pitch over that in the middle.
    [[nodiscard]] double scale_of(const Node& node) const {
        const double area =
            (1 + node.by_x.x / pitch_) * (1 + node.by_y.y / pitch_) - node.by_x.y / pitch_ * node.by_y.x / pitch_;
        return std::sqrt(std::clamp(area, 0.05, 20.0));
    }

    // The finder for lenslets of the local size. Learns one from the last lenslets of that size if there is none yet.
    const CentreFinder& finder_at(const Node& node) {
        const double scale = scale_of(node);
        const auto apart = [](double a, double b) { return std::abs(a / b - 1); };
        if (apart(scale, finders_.nearest_scale(scale)) > kOtherSize && nodes_.size() >= learn_again_) {
            std::vector<PixelPoint> seeds;
            const std::size_t last = nodes_.size() - std::min(nodes_.size(), kSearched);
            for (std::size_t k = nodes_.size(); k-- > last && seeds.size() < kMaxOfSize;) {
                if (apart(scale_of(nodes_[k]), scale) > 0.5 * kOtherSize) continue;
                seeds.push_back({nodes_[k].ideal.x + nodes_[k].off.x, nodes_[k].ideal.y + nodes_[k].off.y});
            }
            auto learned = seeds.size() >= kMinOfSize
                ? CentreFinder::learn(image_, seeds, scale * pitch_, finders_.middle().against())
                : fail(ErrorCode::refused, "too few lenslets", "");
            if (learned) finders_.add(scale, std::move(*learned));
            else learn_again_ = nodes_.size() + kMinOfSize;
        }
        return finders_.at(scale);
    }

    [[nodiscard]] std::optional<Spot> measure(const CentreFinder& finder, PixelPoint at) const {
        auto spot = finder.measure(at, kMaxMiss * pitch_);
        if (!spot || spot->match < kMinMatch || spot->amplitude_dn < kMinAmplitude * finder.typical_amplitude_dn())
            return std::nullopt;
        return spot;
    }

    void add(int m, int n, const Spot& seen, Vector by_x, Vector by_y) {
        const Vector at = ideal(m, n);
        state_[place(m, n)] = static_cast<std::int32_t>(nodes_.size());
        nodes_.push_back(
            {m, n, at, {seen.centre_px.x_px - at.x, seen.centre_px.y_px - at.y}, by_x, by_y, seen.amplitude_dn});
        include(m, n);
        for (int dn = -1; dn <= 1; ++dn) {
            for (int dm = -1; dm <= 1; ++dm) {
                if (contains(m + dm, n + dn)) ++neighbours_[place(m + dm, n + dn)];
            }
        }
    }
    void include(int m, int n) {
        if (nodes_.size() <= 1 && inside_.low_m > inside_.high_m) inside_ = {m, m, n, n};
        inside_.include(m, n);
    }

    void try_lenslet(int m, int n) {
        if (!contains(m, n) || state(m, n) >= 0) return;
        const std::size_t k = place(m, n);
        if (state_[k] == kFailed && (tries_[k] >= kMaxTries || neighbours_[k] < tried_with_[k] + kMoreNeighbours))
            return;
        const Node expected = predict(m, n);
        const PixelPoint at{expected.ideal.x + expected.off.x, expected.ideal.y + expected.off.y};
        state_[k] = kFailed;
        ++tries_[k];
        tried_with_[k] = neighbours_[k];
        if (!steps_.in_frame(at)) return;
        include(m, n);
        const CentreFinder& finder = finder_at(expected);
        if (!finder.complete(at)) return;
        if (const auto seen = measure(finder, at)) add(m, n, *seen, expected.by_x, expected.by_y);
    }

    // From the measured lenslets within kNear columns and rows: a plane through their distances from the ideal places,
    // by least squares, with slopes near those that they were predicted with.
    [[nodiscard]] Node predict(int m, int n) const {
        Node out{.m = m, .n = n, .ideal = ideal(m, n)};
        std::array<const Node*, (2 * kNear + 1) * (2 * kNear + 1)> around{};
        std::array<double, around.size()> weight{};
        std::size_t count = 0;
        double all = 0;
        for (int dn = -kNear; dn <= kNear; ++dn) {
            for (int dm = -kNear; dm <= kNear; ++dm) {
                if (!contains(m + dm, n + dn)) continue;
                const std::int32_t k = state(m + dm, n + dn);
                if (k < 0) continue;
                around[count] = &nodes_[static_cast<std::size_t>(k)];
                weight[count] = std::max(std::abs(dm), std::abs(dn)) > 1 ? kFarWeight : 1;
                all += weight[count++];
            }
        }
        for (std::size_t k = 0; k < count; ++k) {
            const double share = weight[k] / all;
            out.by_x.x += share * around[k]->by_x.x;
            out.by_x.y += share * around[k]->by_x.y;
            out.by_y.x += share * around[k]->by_y.x;
            out.by_y.y += share * around[k]->by_y.y;
        }
        double x = 0, y = 0, xx = kStiffness, xy = 0, yy = kStiffness;
        Vector sum, sum_x, sum_y;
        for (std::size_t k = 0; k < count; ++k) {
            const Node& node = *around[k];
            const double w = weight[k];
            const double dx = (node.ideal.x - out.ideal.x) / pitch_, dy = (node.ideal.y - out.ideal.y) / pitch_;
            const double off_x = w * (node.off.x - out.by_x.x * dx - out.by_y.x * dy);
            const double off_y = w * (node.off.y - out.by_x.y * dx - out.by_y.y * dy);
            x += w * dx, y += w * dy;
            xx += w * dx * dx, xy += w * dx * dy, yy += w * dy * dy;
            sum.x += off_x, sum.y += off_y;
            sum_x.x += dx * off_x, sum_x.y += dx * off_y;
            sum_y.x += dy * off_x, sum_y.y += dy * off_y;
        }
        // The plane's constant eliminated, two slopes are left.
        const double a = xx - x * x / all, b = xy - x * y / all, c = yy - y * y / all, det = a * c - b * b;
        const auto solve = [&](double s, double sx, double sy, double& off, double& by_x, double& by_y) {
            const double rx = sx - x * s / all, ry = sy - y * s / all;
            const double slope_x = (c * rx - b * ry) / det, slope_y = (a * ry - b * rx) / det;
            off = (s - x * slope_x - y * slope_y) / all;
            by_x += slope_x;
            by_y += slope_y;
        };
        solve(sum.x, sum_x.x, sum_y.x, out.off.x, out.by_x.x, out.by_y.x);
        solve(sum.y, sum_x.y, sum_y.y, out.off.y, out.by_x.y, out.by_y.y);
        return out;
    }

    const WhiteImage& image_;
    LocalFinders& finders_;
    const LensletGrid& steps_;
    double pitch_;
    IndexRange box_{1 << 20, -(1 << 20), 1 << 20, -(1 << 20)}, inside_{1, 0, 1, 0};
    int columns_ = 0;
    std::vector<std::int32_t> state_;  // row by row over box_
    std::vector<std::uint8_t> tries_, neighbours_, tried_with_;
    std::vector<Node> nodes_;
    std::size_t next_ = 0, learn_again_ = 0;
};

}  // namespace

void IndexRange::include(int m, int n) {
    low_m = std::min(low_m, m);
    high_m = std::max(high_m, m);
    low_n = std::min(low_n, n);
    high_n = std::max(high_n, n);
}

std::vector<LensletPlace> lenslets_inside(const LensletGrid& grid, const LensletGrid& steps, double reach_px) {
    const std::vector<double>& p = steps.parameters;  // affine
    const double determinant = p[2] * p[5] - p[3] * p[4];
    double low_u = 1e300, high_u = -1e300, low_v = 1e300, high_v = -1e300;
    const double margin_x = 0.1 * grid.width_px + p[2] / steps.span;
    const double margin_y = 0.1 * grid.height_px + p[5] / steps.span;
    for (const double x : {-margin_x, grid.width_px + margin_x}) {
        for (const double y : {-margin_y, grid.height_px + margin_y}) {
            const double u = (p[5] * (x - p[0]) - p[3] * (y - p[1])) / determinant;
            const double v = (p[2] * (y - p[1]) - p[4] * (x - p[0])) / determinant;
            low_u = std::min(low_u, u);
            high_u = std::max(high_u, u);
            low_v = std::min(low_v, v);
            high_v = std::max(high_v, v);
        }
    }
    const double reach = reach_px / std::hypot(p[2], p[4]);
    low_u = std::max(low_u, -reach);
    high_u = std::min(high_u, reach);
    low_v = std::max(low_v, -reach);
    high_v = std::min(high_v, reach);
    const double m_step = (steps.stagger == algo::Stagger::columns ? std::numbers::sqrt3 / 2 : 1) / steps.span;
    const double n_step = (steps.stagger == algo::Stagger::rows ? std::numbers::sqrt3 / 2 : 1) / steps.span;
    std::vector<LensletPlace> out;
    const auto first = [](double low, double step) { return static_cast<int>(std::floor(low / step)) - 1; };
    for (int n = first(low_v, n_step); n <= static_cast<int>(std::ceil(high_v / n_step)) + 1; ++n) {
        for (int m = first(low_u, m_step); m <= static_cast<int>(std::ceil(high_u / m_step)) + 1; ++m) {
            const LensletGrid::Uv uv = grid.uv(m, n);
            if (uv.u < low_u || uv.u > high_u || uv.v < low_v || uv.v > high_v) continue;
            const PixelPoint at = grid.at(uv);
            if (grid.in_frame(at)) out.push_back({m, n, at});
        }
    }
    return out;
}

Result<LensletChain> follow_chains(const WhiteImage& image, LocalFinders& finders, const LensletGrid& steps,
                                   double pitch_px) {
    Chains chains(image, finders, steps, pitch_px);
    // The first lenslet is one that others follow; a speck of light is not.
    constexpr std::size_t kFewest = 9;
    const std::vector<LensletPlace> places =
        lenslets_inside(steps, steps, 0.5 * std::max(steps.width_px, steps.height_px));
    const PixelPoint seed = steps.at(steps.uv(0, 0));
    // The nearest to the seed first. Few are tried: a heap orders no more of them.
    std::vector<std::pair<double, std::size_t>> by_distance;
    by_distance.reserve(places.size());
    for (std::size_t k = 0; k < places.size(); ++k) {
        const double dx = places[k].at.x_px - seed.x_px, dy = places[k].at.y_px - seed.y_px;
        by_distance.emplace_back(dx * dx + dy * dy, k);
    }
    std::make_heap(by_distance.begin(), by_distance.end(), std::greater<>());
    for (; !by_distance.empty() && chains.size() < kFewest; by_distance.pop_back()) {
        std::pop_heap(by_distance.begin(), by_distance.end(), std::greater<>());
        const LensletPlace& place = places[by_distance.back().second];
        chains.start(place.m, place.n, place.at);
    }
    const auto smooth = [&] {
        constexpr std::size_t kEnough = 4000;  // lenslets: more do not change the surface
        std::vector<Observation> seen =
            chains.observations(std::max<std::size_t>(1, (chains.size() + kEnough - 1) / kEnough));
        const int order = seen.size() >= 200 ? 3 : seen.size() >= 60 ? 2 : 1;
        return robust_polynomial(steps, seen, order);
    };
    std::optional<LensletGrid> grid = smooth();
    // Light in separate regions: the polynomial leads from one to the next.
    const std::size_t before = chains.size();
    if (grid) {
        for (const LensletPlace& place : lenslets_inside(*grid, steps)) {
            if (chains.reached(place.m, place.n)) continue;
            const LensletGrid::Steps of_grid = grid->steps_px(grid->uv(place.m, place.n));
            const LensletGrid::Steps of_steps = steps.steps_px(steps.uv(place.m, place.n));
            // d off / d ideal, a pitch: (grid steps - lattice steps) times the inverse of the lattice steps.
            const double det = of_steps.area_px2() / pitch_px;
            const Vector u{of_grid.along_u.x_px - of_steps.along_u.x_px, of_grid.along_u.y_px - of_steps.along_u.y_px};
            const Vector v{of_grid.along_v.x_px - of_steps.along_v.x_px, of_grid.along_v.y_px - of_steps.along_v.y_px};
            const Vector by_x{(u.x * of_steps.along_v.y_px - v.x * of_steps.along_u.y_px) / det,
                              (u.y * of_steps.along_v.y_px - v.y * of_steps.along_u.y_px) / det};
            const Vector by_y{(v.x * of_steps.along_u.x_px - u.x * of_steps.along_v.x_px) / det,
                              (v.y * of_steps.along_u.x_px - u.y * of_steps.along_v.x_px) / det};
            chains.start(place.m, place.n, place.at, by_x, by_y);
        }
        if (chains.size() > before) grid = smooth();
    }
    if (!grid) {
        return fail(ErrorCode::refused, fmt::format("only {} lenslets can be measured", chains.size()),
                    "show at least three rows and three columns of evenly lit lenslets, in one exposure");
    }
    LensletChain out;
    out.observations = chains.observations();
    out.inside = chains.inside();
    out.smooth = std::move(*grid);
    for (const LensletPlace& place : lenslets_inside(out.smooth, steps)) out.inside.include(place.m, place.n);
    chains.check(out.apart, out.torn);
    return out;
}

}  // namespace hord::calib
