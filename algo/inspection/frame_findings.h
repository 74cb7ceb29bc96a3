// What the checks of a whole frame found (algo/inspection/frame_checks.h): measured values, and the one thing that is
// wrong with the frame, if any.
#pragma once

#include <cstdint>

namespace hord::algo {

// What is wrong with a frame, in words that a cure can follow.
enum class FrameFault : std::uint8_t {
    none,
    dim,  // Reason::too_dark: no whole part is seen, and the dark level takes much of the light
    // Reason::unexpected_geometry
    other_period,  // the light repeats with another period than the macro-pixels' size
    split_spots,   // the light lies at opposite edges of the bins: the macro-pixels drift against the frame
    turned,        // the bins are turned against the frame: the free light drifts as no part deflects it
    // Reason::unexpected_light
    pedestal,      // the dark bins read more than is allowed: fog, black level
    noise,         // pedestal and noise of the dark bins together take more than is allowed
    off_centre,    // undeflected light is not in the middle of its lenslet
    wide_spot,     // spots are wider than a collimated source makes them: defocus, stray light
    wide_inside,   // spots behind a plate are wider than beside it: a blurred shadow, or a plate that scatters all over
    fog_beside,    // bins that must be dark read more beside a plate than behind it: fog, stray light
    second_spot,   // a second spot beside the main one: ghost, neighbouring light, a second exposure
    alternating,   // neighbouring lenslets differ in turn: interlaced exposures, taps of the sensor
    glare,         // the part is far brighter than free light: another lamp, a reflection
    blurred_edge,  // the light falls over several lenslets at the part's edges: it moved, or was exposed twice
    interrupted,   // a row or column shows too little free light: lost rows, a hair, a part from border to border
    // Reason::no_part
    nothing,       // no region is large enough to be a part
    fills_field,   // no free light around it: the part is larger than the field, or something else covers the field
    no_outline,    // the light jumps across less than half of the outline: uneven light, or too fine an edge
    several,       // more than one part
    cut_by_field,  // a part that the field's border cuts off
    lopsided,      // the part's outline is not symmetric: a piece of it is missing or covered
    notched,       // the part's outline is not convex: pieces of it are missing or covered
    no_flanks,     // a tube that the field cuts lengthwise, or whose edges show no flanks
    hollow,        // an outline with free light inside: a ring, or a flat part of another form
    not_flat,      // a plate that the field cuts, and that deflects light nearly everywhere: lost samples, another part
    no_steps,      // a plate with too little light beside its edges to tell whether it takes any
    shadow,        // the edges of a plate, and a soft shadow about them: hairs, a frame
    clear_middle,  // the edges of a plate that takes light, but not in its middle: a hole, or hairs with a soft shadow
    unproven,      // the edges of a plate, and nothing between them that takes or deflects light: hairs, a frame
};

struct FrameFindings {
    FrameFault fault = FrameFault::none;

    bool dark_measured = false;  // lenslets have dark bins enough to measure them
    float pedestal_dn = 0;       // median of the dark bins
    float dark_noise_dn = 0;     // their standard deviation, rounding included
    // The dark level that both ask for, and what is allowed: of the pedestal alone, and of that level.
    float wanted_dark_dn = 0, dark_limit_dn = 0, noise_limit_dn = 0;

    // Share of the light of these lenslets that the dark level takes: it is subtracted from every lit bin, and fainter
    // bins count as dark.
    float lost_share = 0;
    int fewer_bits = 0;          // of a dim frame: the bit depth that its samples look like; 0: that of the frame
    bool in_free_light = false;  // spot and offset are those of the free light; else of all lit lenslets
    bool spot_measured = false;
    float x_bins = 0, y_bins = 0;            // mean deflection of the free light from where it is expected, bin pitches
    float spot_x_bins = 0, spot_y_bins = 0;  // root mean square of the spot along each axis, bin pitches
    float inside_x_bins = 0, inside_y_bins = 0;  // the same behind a plate that hardly deflects light
    float floor_dn = 0, inside_floor_dn = 0;     // what bins without light read, in the free light and behind a plate
    float second_share = 0;                      // of the light, in spots beside the main one
    float undeflected_share = 0;  // of the light where the part deflects light far: what stays undeflected
    float alternation_bins = 0, alternation_light = 0;  // algo/light/exposures.h: bin pitches; relative
    float split_share = 0;                              // of the judged lenslets, light at opposite edges of the bins
    float glare_share = 0;                              // of the judged lenslets, far brighter than free light
    float lit_share = 0;                                // of the bins
    float turned_rad = 0;                               // of the bins against the frame, where there is no free light

    int period_x = 0, period_y = 0;  // samples between repetitions; 0: not clear, or not measured because all is well

    int parts = 0;          // regions of at least 1/16 of the field, and smaller ones beside them that are no dust
    float border_cut = 0;   // outermost lenslets of the field that belong to a part, over the part's diameter
    float sharp_share = 0;  // share of the part's outline across which the light jumps
    int edge_width = 0;     // lenslets in which the light falls at the part's edge, their median
    float free_beside = 1;  // least share of free light beside the part in a row or column
    float symmetry = 0;     // overlap of the part and its image turned by 180 degrees, over both together
    float convexity = 0;    // of the part, with what it encloses, over its convex hull
    float shaded = 0;       // share of the steps across a plate's edges at which the light inside is less than outside
    int shaded_steps = 0;   // how many steps could be compared
    float deflecting = 1;   // share of the inside of the part that deflects light, or is dark
};

}  // namespace hord::algo
