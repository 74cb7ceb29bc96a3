#include "tests/support/odd_frames.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/frames.h"
#include "tests/support/light_image.h"

namespace hord::algo::testing {
namespace {

constexpr double kPeakDn = 200, kSpread = 0.6;

double smallest(const Extents& e) { return std::min(e.m, e.n); }
double middle_m(const Extents& e) { return (e.m - 1) / 2.0; }
double middle_n(const Extents& e) { return (e.n - 1) / 2.0; }

struct Lens {
    double m, n, radius, rim_bins;
};
// A round lens, moved from the middle of the field by a share of the field's shorter side.
Lens lens_at(const Extents& e, double right = 0, double down = 0, double radius = 0.38) {
    return {middle_m(e) + right * smallest(e), middle_n(e) + down * smallest(e), radius * smallest(e),
            std::min(0.33 * std::min(e.i, e.j), 3.0)};
}
Spot of_lens(const Lens& lens, int m, int n) {
    const double right = m - lens.m, down = n - lens.n;
    if (std::hypot(right, down) > lens.radius) return {};
    return {-right / lens.radius * lens.rim_bins, -down / lens.radius * lens.rim_bins, 1};
}
LightImage lens_light(const Extents& e, const Lens& lens, double spread = kSpread) {
    return spots(e, kPeakDn, spread, [=](int m, int n) { return of_lens(lens, m, n); });
}
LightImage lens_light(const Extents& e) { return lens_light(e, lens_at(e)); }
LightImage empty_light(const Extents& e) {
    return spots(e, kPeakDn, kSpread, [](int, int) { return Spot{}; });
}

Frame filled(const Extents& e, const std::function<std::uint32_t(int x, int y)>& sample) {
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) frame.set(x, y, sample(x, y));
    }
    return frame;
}

// A lens of other macro-pixels in a frame of the same size.
std::optional<Frame> of_other_bins(const Extents& e, int i, int j, std::uint64_t seed, bool with_lens) {
    if (e.width_px() % i != 0 || e.height_px() % j != 0 || (i == e.i && j == e.j)) return std::nullopt;
    const Extents other{e.width_px() / i, e.height_px() / j, i, j};
    return exposed(with_lens ? lens_light(other) : empty_light(other), {}, seed);
}

Kind of_light(std::string name, const std::function<LightImage(const Extents&)>& light, const Sensor& sensor = {}) {
    return {std::move(name), [light, sensor](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
                return exposed(light(e), sensor, seed);
            }};
}
Kind of_samples(std::string name, const std::function<std::uint32_t(int x, int y)>& sample) {
    return {std::move(name),
            [sample](const Extents& e, std::uint64_t) -> std::optional<Frame> { return filled(e, sample); }};
}

// Nothing, or no light of this cell.
void add_empty_kinds(std::vector<Kind>& kinds) {
    kinds.push_back(of_samples("black", [](int, int) { return 0U; }));
    kinds.push_back(of_samples("one grey, 2 DN", [](int, int) { return 2U; }));
    kinds.push_back(of_samples("white", [](int, int) { return 255U; }));
    kinds.push_back(of_samples("grey fog, 120 DN", [](int, int) { return 120U; }));
    kinds.push_back({"fog with a gradient", [](const Extents& e, std::uint64_t) -> std::optional<Frame> {
                         return filled(e, [&](int x, int y) {
                             return 40U + static_cast<std::uint32_t>(120 * (x + y) / (e.width_px() + e.height_px()));
                         });
                     }});
    kinds.push_back({"ramp from 0 to 254 DN", [](const Extents& e, std::uint64_t) -> std::optional<Frame> {
                         return filled(
                             e, [&](int x, int) { return static_cast<std::uint32_t>(254 * x / (e.width_px() - 1)); });
                     }});
    const auto noise = [](double mean, double sigma) {
        return [=](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
            return exposed({e, std::vector<double>(static_cast<std::size_t>(e.width_px() * e.height_px()))},
                           {mean, sigma, 1, false}, seed);
        };
    };
    kinds.push_back({"noise of 3 DN", noise(0, 3)});
    kinds.push_back({"noise of 6 DN on 8 DN", noise(8, 6)});
    kinds.push_back({"noise of 20 DN on 100 DN", noise(100, 20)});
    kinds.push_back({"random bytes", [](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
                         std::mt19937_64 random(seed);
                         return filled(e, [&](int, int) { return static_cast<std::uint32_t>(random() % 256); });
                     }});
    kinds.push_back({"random lit samples, one in forty", [](const Extents& e, std::uint64_t seed) {
                         std::mt19937_64 random(seed);
                         return std::optional(filled(e, [&](int, int) {
                             return random() % 40 == 0 ? static_cast<std::uint32_t>(50 + random() % 200) : 0U;
                         }));
                     }});
    kinds.push_back(of_samples("checkerboard of samples", [](int x, int y) { return (x + y) % 2 == 0 ? 200U : 0U; }));
    kinds.push_back(of_light("checkerboard of lenslets", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [](int m, int n) { return Spot{0, 0, (m + n) % 2 == 0 ? 1.0 : 0.0}; });
    }));
    kinds.push_back(of_samples("stripes of 7 samples", [](int x, int) { return x % 7 < 3 ? 180U : 0U; }));
    kinds.push_back(of_light("empty field", empty_light));
    kinds.push_back(of_light("empty field with noise of 2 DN", empty_light, {2, 2}));
    kinds.push_back(of_light("empty field with a tenth of the light", empty_light, {0, 0.2, 0.1}));
    kinds.push_back(of_light("empty field, uneven lamp", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [=](int m, int n) {
            return Spot{0, 0, 0.15 + 0.85 * std::hypot(m - middle_m(e), n - middle_n(e)) / smallest(e)};
        });
    }));
    kinds.push_back(of_light("empty field, light bent slowly", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [=](int m, int n) {
            const double r = std::hypot(m - middle_m(e), n - middle_n(e)) / smallest(e);
            return Spot{1.2 * std::exp(-r * r / 0.03), 0, 1};
        });
    }));
    kinds.push_back(of_light("empty field with specks of dust", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [=](int m, int n) {
            return Spot{0, 0, m % 11 == 5 && n % 13 == 6 ? 0.0 : 1.0};
        });
    }));
    kinds.push_back(
        of_light("lamp off", [](const Extents& e) { return spots(e, 2, kSpread, [](int, int) { return Spot{}; }); }));
}

// Light that is not where the calibration says, with a lens and without.
void add_light_kinds(std::vector<Kind>& kinds, bool with_lens) {
    const std::string of = with_lens ? "lens, " : "empty field, ";
    const auto light = [=](const Extents& e) { return with_lens ? lens_light(e) : empty_light(e); };
    const auto add = [&](const std::string& name, const std::function<LightImage(const Extents&)>& change,
                         const Sensor& sensor = {}) { kinds.push_back(of_light(of + name, change, sensor)); };
    for (const double shift : {1.0, 1.5, 4.0})
        add("shifted by " + std::to_string(shift).substr(0, 3) + " samples",
            [=](const Extents& e) { return moved_px(light(e), shift, 0); });
    add("shifted down by half a macro-pixel", [=](const Extents& e) { return moved_px(light(e), 0, 0.5 * e.j); });
    add("defocused", [=](const Extents& e) { return blurred(light(e), 1.3); });
    kinds.push_back({of + "ghost of 20 %", [=](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
                         if (std::min(e.i, e.j) < 7) return std::nullopt;  // it blends with the main spot
                         return exposed(with_ghost(light(e), 0.2, 2, 1), {}, seed);
                     }});
    add("ghost of 20 %, half a macro-pixel away",
        [=](const Extents& e) { return with_ghost(light(e), 0.2, e.i / 2, -(e.j / 2)); });
    add("fog of 30 DN", [=](const Extents& e) { return changed(light(e), [](int, int, double v) { return v + 30; }); });
    add("fog from 0 to 60 DN", [=](const Extents& e) {
        return changed(light(e), [&](int x, int, double v) { return v + 60.0 * x / e.width_px(); });
    });
    add("pedestal of 20 DN", light, {20, 0.6});
    add("noise of 12 DN on 15 DN", light, {15, 12});
    add("inverted",
        [=](const Extents& e) { return changed(light(e), [](int, int, double v) { return std::max(0.0, 254 - v); }); });
    add("lamp off in the left half", [=](const Extents& e) {
        return changed(light(e), [&](int x, int, double v) { return 2 * x < e.width_px() ? 0.0 : v; });
    });
    add("a quarter of the rows lost", [=](const Extents& e) {
        return changed(light(e), [&](int, int y, double v) { return 4 * y > 3 * e.height_px() ? 0.0 : v; });
    });
    add("stuck rows beside the middle", [=](const Extents& e) {
        return changed(light(e), [&](int, int y, double v) { return y / e.j >= 1 && y / e.j <= 2 ? 0.0 : v; });
    });
    add("stuck columns", [=](const Extents& e) {
        return changed(light(e), [&](int x, int, double v) { return x / e.i == 1 || x / e.i == 2 ? 0.0 : v; });
    });
    add("rows moved by 3 samples from the middle on", [=](const Extents& e) {
        const LightImage shifted = moved_px(light(e), 3, 0);
        return changed(light(e), [&](int x, int y, double v) { return 2 * y > e.height_px() ? shifted.at(x, y) : v; });
    });
}

// A lens of which a piece is missing: `piece` says where, from places relative to the radius.
void add_pieces(std::vector<Kind>& kinds) {
    const auto add = [&](const std::string& name, const std::function<bool(double right, double down)>& piece) {
        kinds.push_back(of_light(name, [=](const Extents& e) {
            const Lens lens = lens_at(e, 0, 0, 0.45);
            return spots(e, kPeakDn, kSpread, [=](int m, int n) {
                return piece((m - lens.m) / lens.radius, (n - lens.n) / lens.radius) ? Spot{} : of_lens(lens, m, n);
            });
        }));
    };
    const auto turned = [](double right, double down) { return std::abs(std::atan2(down, right)); };
    add("a part without a quarter, at its right", [=](double x, double y) { return turned(x, y) < 0.785; });
    add("a part without a quarter, at its top", [=](double x, double y) { return turned(-y, x) < 0.785; });
    add("a part with a slot from its right", [](double x, double y) { return x > -0.2 && std::abs(y) < 0.35; });
    add("a part with a bite at its right", [](double x, double y) { return std::hypot(x - 1, y) < 0.45; });
    add("a part without a chord", [](double x, double) { return x > 0.55; });
    add("a part with bites at both sides", [](double x, double y) { return std::hypot(std::abs(x) - 1, y) < 0.45; });
    add("a cross cut from a part", [](double x, double y) { return std::min(std::abs(x), std::abs(y)) > 0.3; });
    add("a part with two slots, turned by 180 degrees",
        [](double x, double y) { return x * y < 0 && std::abs(x) > 0.1 && std::abs(std::abs(y) - 0.3) < 0.2; });
    for (const double light : {0.45, 0.15}) {
        kinds.push_back(
            of_light("a grey disc, " + std::to_string(light).substr(0, 4) + " of the light", [=](const Extents& e) {
                return spots(e, kPeakDn, kSpread, [=, lens = lens_at(e)](int m, int n) {
                    return Spot{0, 0, std::hypot(m - lens.m, n - lens.n) <= lens.radius ? light : 1.0};
                });
            }));
    }
    kinds.push_back({"a third of a part", [=](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
                         if (smallest(e) < 40) return std::nullopt;  // too coarse an outline
                         const Lens lens = lens_at(e);
                         return exposed(spots(e, kPeakDn, kSpread,
                                              [=](int m, int n) {
                                                  return turned(m - lens.m, n - lens.n) > 1.047 ? Spot{}
                                                                                                : of_lens(lens, m, n);
                                              }),
                                        {}, seed);
                     }});
    kinds.push_back(of_light("a thin dark ring with nothing in it", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [lens = lens_at(e)](int m, int n) {
            return Spot{0, 0, std::abs(std::hypot(m - lens.m, n - lens.n) - lens.radius) < 1 ? 0.0 : 1.0};
        });
    }));
}

// Light of another exposure or lamp, or missing over most of the part.
void add_mixed_kinds(std::vector<Kind>& kinds) {
    kinds.push_back(of_light("lens, even stray light in its middle, five times the free light", [](const Extents& e) {
        const LightImage part = lens_light(e, lens_at(e)), empty = empty_light(e);
        double sum = 0;
        for (int y = 0; y < e.j; ++y) {
            for (int x = 0; x < e.i; ++x) sum += empty.at(x, y);
        }
        const double middle_x = 0.5 * e.width_px(), middle_y = 0.5 * e.height_px(), radius = 0.15 * e.width_px();
        return changed(part, [=](int x, int y, double v) {
            const double far = std::hypot(x - middle_x, y - middle_y) / radius;
            return v + 5 * sum / e.bins() * std::exp(-far * far);
        });
    }));
    const auto shadow = [&](const std::string& name, double from, double light) {
        kinds.push_back(of_light(name, [=](const Extents& e) {
            return spots(e, kPeakDn, kSpread, [=, lens = lens_at(e)](int m, int n) {
                Spot spot = of_lens(lens, m, n);
                const bool inside = std::hypot(m - lens.m, n - lens.n) <= lens.radius;
                if (inside && m > lens.m + from * lens.radius) spot.light = light;
                return spot;
            });
        }));
    };
    shadow("lens, 30 % of the light in two thirds of it", -0.25, 0.3);
    shadow("lens, a tenth of the light in four fifths of it", -0.5, 0.1);
    const auto in_turn = [&](const std::string& name, const std::function<bool(int m, int n)>& other, double light) {
        kinds.push_back(of_light(name, [=](const Extents& e) {
            return spots(e, kPeakDn, kSpread, [=, lens = lens_at(e)](int m, int n) {
                const bool inside = std::hypot(m - lens.m, n - lens.n) <= lens.radius;
                if (!inside || !other(m, n)) return of_lens(lens, m, n);
                return light < 0 ? Spot{} : Spot{of_lens(lens, m, n).x, of_lens(lens, m, n).y, light};
            });
        }));
    };
    in_turn(
        "lens and an empty field, row by row", [](int, int n) { return n % 2 == 0; }, -1);
    in_turn(
        "lens and an empty field, lenslet by lenslet", [](int m, int n) { return (m + n) % 2 == 0; }, -1);
    in_turn(
        "lens, every second column with 60 % of the light", [](int m, int) { return m % 2 == 0; }, 0.6);
    for (const double share : {0.2, 0.5, 0.7}) {
        kinds.push_back(
            {"lens and an empty field in one exposure, " + std::to_string(share).substr(0, 3) + " of it",
             [=](const Extents& e, std::uint64_t seed) -> std::optional<Frame> {
                 if (std::min(e.i, e.j) < 9) return std::nullopt;  // no light is deflected far enough
                 Lens lens = lens_at(e);
                 lens.rim_bins = 0.47 * std::min(e.i, e.j);
                 const LightImage part = lens_light(e, lens), empty = empty_light(e);
                 return exposed(
                     changed(part, [&](int x, int y, double v) { return (1 - share) * v + share * empty.at(x, y); }),
                     {}, seed);
             }});
    }
}

// Something is there, but not one whole part.
void add_part_kinds(std::vector<Kind>& kinds) {
    const auto two = [](const Extents& e, const Lens& a, const Lens& b) {
        return spots(e, kPeakDn, kSpread, [=](int m, int n) {
            const Spot spot = of_lens(a, m, n);
            return spot.x == 0 && spot.y == 0 ? of_lens(b, m, n) : spot;
        });
    };
    kinds.push_back(of_light(
        "two parts", [=](const Extents& e) { return two(e, lens_at(e, -0.24, 0, 0.2), lens_at(e, 0.24, 0, 0.2)); }));
    kinds.push_back(of_light("two parts, corner to corner", [=](const Extents& e) {
        return two(e, lens_at(e, -0.22, -0.22, 0.22), lens_at(e, 0.22, 0.22, 0.22));
    }));
    struct Place {
        const char* name;
        double right, down;
    };
    for (const double size : {0.45, 0.3, 0.2}) {
        for (const Place at :
             {Place{"in a corner", -0.38, 0.38}, Place{"beside it", 0.1, -0.42}, Place{"at the border", 0.49, -0.05}}) {
            kinds.push_back(
                of_light("a part and a second one of " + std::to_string(size).substr(0, 4) + " of its size, " + at.name,
                         [=](const Extents& e) {
                             return two(e, lens_at(e, -0.04, 0.04, 0.3), lens_at(e, at.right, at.down, 0.3 * size));
                         }));
        }
        kinds.push_back(of_light(
            "a part and a plate of " + std::to_string(size).substr(0, 4) + " of its size", [=](const Extents& e) {
                const Lens part = lens_at(e, 0, 0, 0.3), plate = lens_at(e, -0.36, -0.36, 0.3 * size);
                return spots(e, kPeakDn, kSpread, [=](int m, int n) {
                    Spot spot = of_lens(part, m, n);
                    const double far = std::max(std::abs(m - plate.m), std::abs(n - plate.n));
                    if (std::abs(far - plate.radius) < 0.6) spot.light = 0;
                    return spot;
                });
            }));
    }
    kinds.push_back(of_light("half a part at the field's left border",
                             [](const Extents& e) { return lens_light(e, lens_at(e, -0.5)); }));
    kinds.push_back(of_light("half a part at the field's lower border",
                             [](const Extents& e) { return lens_light(e, lens_at(e, 0, 0.48)); }));
    kinds.push_back(of_light("a quarter of a part in a corner",
                             [](const Extents& e) { return lens_light(e, lens_at(e, 0.48, -0.48)); }));
    kinds.push_back(of_light("half a part in the middle of the field",
                             [](const Extents& e) { return joined(lens_light(e), empty_light(e), e.m / 2); }));
    kinds.push_back(of_light("a part without a quarter", [](const Extents& e) {
        const Lens lens = lens_at(e);
        return spots(e, kPeakDn, kSpread,
                     [=](int m, int n) { return m > lens.m && n < lens.n ? Spot{} : of_lens(lens, m, n); });
    }));
    kinds.push_back(
        of_light("part outside the field", [](const Extents& e) { return lens_light(e, lens_at(e, 1.2)); }));
    kinds.push_back(
        of_light("a tenth of a part at the border", [](const Extents& e) { return lens_light(e, lens_at(e, 0.8)); }));
    kinds.push_back(of_light("a part much smaller than the field",
                             [](const Extents& e) { return lens_light(e, lens_at(e, 0.1, 0, 0.1)); }));
    kinds.push_back(
        of_light("a part that fills the field", [](const Extents& e) { return lens_light(e, lens_at(e, 0, 0, 1.2)); }));
    kinds.push_back(of_light("an opaque sheet over the upper half", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [=](int, int n) { return Spot{0, 0, 2 * n < e.n ? 0.0 : 1.0}; });
    }));
    kinds.push_back(of_light("an opaque holder without a part", [](const Extents& e) {
        return spots(e, kPeakDn, kSpread, [=](int m, int n) {
            return Spot{0, 0, std::hypot(m - middle_m(e), n - middle_n(e)) < 0.35 * smallest(e) ? 1.0 : 0.0};
        });
    }));
    add_pieces(kinds);
    for (const auto& [i, j] : {std::pair(3, 3), std::pair(5, 5), std::pair(7, 7), std::pair(9, 9), std::pair(15, 15),
                               std::pair(10, 10), std::pair(9, 3)}) {
        for (const bool with_lens : {true, false}) {
            kinds.push_back({(with_lens ? "lens" : "empty field") + std::string(" of ") + std::to_string(i) + "x" +
                                 std::to_string(j) + " bins",
                             [i = i, j = j, with_lens](const Extents& e, std::uint64_t seed) {
                                 return of_other_bins(e, i, j, seed, with_lens);
                             }});
        }
    }
}

}  // namespace

const std::vector<Kind>& unfit_kinds() {
    static const std::vector<Kind> kinds = [] {
        std::vector<Kind> all;
        add_empty_kinds(all);
        add_light_kinds(all, false);
        add_light_kinds(all, true);
        add_part_kinds(all);
        add_mixed_kinds(all);
        return all;
    }();
    return kinds;
}

const std::vector<Kind>& good_kinds() {
    static const std::vector<Kind> kinds = [] {
        std::vector<Kind> all;
        const auto lens = [](const Extents& e) { return lens_light(e); };
        all.push_back(of_light("lens", lens));
        for (const double pedestal : {1.0, 2.0, 3.0, 4.5, 6.0, 8.0}) {
            for (const double noise : {0.0, 0.6, 2.0})
                all.push_back(of_light("lens, pedestal " + std::to_string(pedestal).substr(0, 3) + " DN, noise " +
                                           std::to_string(noise).substr(0, 3) + " DN",
                                       lens, {pedestal, noise}));
        }
        all.push_back(of_light("lens, noise of 1 DN", lens, {0, 1}));
        all.push_back(of_light("lens, noise of 2 DN", lens, {0, 2}));
        all.push_back(of_light("lens, half the light", lens, {0, 0.6, 0.5}));
        all.push_back(of_light("lens, half the light, pedestal 8 DN, noise 2 DN", lens, {8, 2, 0.5}));
        all.push_back(of_light("lens, wide source", [](const Extents& e) { return lens_light(e, lens_at(e), 0.7); }));
        all.push_back(of_light("lens, upside down", [](const Extents& e) {
            const LightImage light = lens_light(e);
            return changed(light,
                           [&](int x, int y, double) { return light.at(e.width_px() - 1 - x, e.height_px() - 1 - y); });
        }));
        all.push_back(of_light("lens, a third of a bin off",
                               [](const Extents& e) { return moved_px(lens_light(e), 0.3, -0.3); }));
        all.push_back(
            of_light("lens off the middle", [](const Extents& e) { return lens_light(e, lens_at(e, 0.06, -0.08)); }));
        all.push_back(of_light("lens that touches the border", [](const Extents& e) {
            return lens_light(e, lens_at(e, 0.5 - 0.38 + 0.4 / smallest(e)));
        }));
        all.push_back(of_light("square wedge", [](const Extents& e) {
            return spots(e, kPeakDn, kSpread, [=](int m, int n) {
                const bool inside = std::max(std::abs(m - middle_m(e)), std::abs(n - middle_n(e))) < 0.3 * smallest(e);
                return inside ? Spot{0.2 * e.i, 0.1 * e.j, 0.9} : Spot{};
            });
        }));
        all.push_back(of_light("cylinder lens, open ends", [](const Extents& e) {
            return spots(e, kPeakDn, kSpread, [=](int m, int n) {
                const double right = m - middle_m(e), half = 0.36 * smallest(e);
                const bool inside = std::abs(right) < half && std::abs(n - middle_n(e)) < half;
                return inside ? Spot{-right / half * 0.28 * e.i, 0, 0.95} : Spot{};
            });
        }));
        return all;
    }();
    return kinds;
}

}  // namespace hord::algo::testing
