// The first look at a frame: every row is decoded, and compared with its neighbours while it is in cache.
#include <algorithm>
#include <utility>

#include "algo/inspection/pipeline_workspace.h"

namespace hord::algo {

// The macro-pixel frame, whose rows are still to be decoded if `frame` is raw. Fails if it is not of the extents' or
// the calibration's size, or of another bit depth.
Result<FrameView> Pipeline::Workspace::take_in(const FrameView& frame) {
    if (!macro_pixels) {
        if (auto fine = check_frame(frame, extents, bits); !fine) return tl::unexpected(fine.error());
        return frame;
    }
    RawRows& rows = *workers[0].raw;
    if (auto fine = rows.check(frame); !fine) return tl::unexpected(fine.error());
    if (frame.bits != bits) {
        return fail(ErrorCode::invalid_argument, std::to_string(frame.bits) + "-bit samples",
                    "give frames of " + std::to_string(bits) + " bits");
    }
    raw = frame;
    for (PipelineWorker& worker : workers) worker.raw->begin_frame();
    checks.for_each_sampled([&](int m, int n) { rows.decode_lenslet(raw, m, n, *macro_pixels); });
    return macro_pixels->view();
}

// Sums, mean deflections, mask and the features over neighbours, of every lenslet.
void Pipeline::Workspace::compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times) {
    const int rows = pool->rows_a_band(extents.n);
    for (PipelineWorker& worker : workers) worker.next_row = -1;
    pool->share_out((extents.n + rows - 1) / rows, [&](int worker, int band) {
        Stopwatch untimed(nullptr);
        StageTimes unused;
        const bool caller = worker == 0;
        const int first = band * rows, last = std::min(first + rows, extents.n);
        PipelineWorker& w = workers[static_cast<std::size_t>(worker)];
        Stopwatch& by = caller ? watch : untimed;
        StageTimes& to = caller ? times : unused;
        if (w.emd) compute_band(w, *w.emd, frame, first, last, by, to);
        else compute_band(w, *w.soa, frame, first, last, by, to);
    });
    watch.lap(times.feature_ns);
}

// The maps of rows first..last-1. Rows first-1 and last, if they exist, are decoded for the gradients; where the
// thread's last band ended at `first`, rows first-1 and first are loaded.
template <class Rows>
void Pipeline::Workspace::compute_band(PipelineWorker& worker, Rows& rows, const FrameView& frame, int first, int last,
                                       Stopwatch& watch, StageTimes& times) {
    const auto in_band = [&](int n) { return n >= first && n < last; };
    const bool goes_on = std::exchange(worker.next_row, last) == first;
    if (goes_on && worker.raw) worker.raw->copy_beyond(first, *macro_pixels);
    for (int n = goes_on ? first : std::max(first - 1, 0); n < std::min(last + 1, extents.n); ++n) {
        if (!goes_on || n > first) load(worker, rows, frame, n, in_band(n), watch, times);
        finish_decoding(rows, n, in_band(n));
        watch.lap(times.hord_ns);
        if (in_band(n - 1)) compare_row(rows, n - 1);
        watch.lap(times.feature_ns);
    }
    if (last == extents.n) compare_row(rows, last - 1);
    finish_gradients(rows, last);
    watch.lap(times.feature_ns);
}

template <class Rows>
void Pipeline::Workspace::load(PipelineWorker& worker, Rows& rows, const FrameView& frame, int n, bool in_band,
                               Stopwatch& watch, StageTimes& times) {
    FrameView from = frame;
    int row = n;
    if (worker.raw && in_band) worker.raw->decode(raw, n, *macro_pixels);
    if (worker.raw && !in_band) {
        from = worker.raw->decode_beyond(raw, n);
        row = 0;
    }
    watch.lap(times.resample_ns);
    rows.load(from, levels, n, row);
    watch.lap(times.decode_ns);
}

// What compare_row() needs of row n, and the maps of sums and mean deflections if it is in the band.
void Pipeline::Workspace::finish_decoding(EmdRows& rows, int n, bool in_band) {
    const HordRow& hords = rows.window.row(n);
    mean_deflections(hords, rows.deflections_of(n));
    rows.window.compact_row(n);
    if (!in_band) return;
    const auto row = static_cast<std::ptrdiff_t>(extents.index(0, n));
    std::ranges::copy(rows.deflections_of(n), deflections.begin() + row);
    std::ranges::copy(hords.sums(), sums.begin() + row);
}

void Pipeline::Workspace::finish_decoding(SoaDistances& rows, int n, bool in_band) {
    if (!in_band) return;
    const SoaRow& row = rows.loaded(n);
    std::copy_n(row.sums().begin(), extents.m, sums.begin() + static_cast<std::ptrdiff_t>(extents.index(0, n)));
    for (int m = 0; m < extents.m; ++m) {
        const bool dark = (row.mask()[static_cast<std::size_t>(m)] & kDark) != 0;
        deflections[extents.index(m, n)] = dark ? Deflection{} : rows.deflection(m, n);
    }
}

// Mask and features of row n; rows n-1 and n+1 are decoded. EMD gradients are submitted to the solver.
void Pipeline::Workspace::compare_row(EmdRows& rows, int n) {
    const RowWindow& window = rows.window;
    for (int m = 0; m < extents.m; ++m) {
        const std::size_t k = extents.index(m, n);
        EmdGradient& submitted = rows.gradients[rows.submitted++];
        submitted = {};
        Jacobian jacobian;
        const RowWindow::Neighbours next = window.neighbours(m, n);
        mask[k] = next.mask;
        if ((next.mask & kNoGradient) == 0) {
            submit_emd_gradient(rows.solver, next.across, window.sparse(next.left, n), window.sparse(next.right, n),
                                next.down, window.sparse(m, next.above), window.sparse(m, next.below), submitted);
            jacobian = jacobian_of(next.across, rows.deflection(next.left, n), rows.deflection(next.right, n),
                                   next.down, rows.deflection(m, next.above), rows.deflection(m, next.below));
        }
        if (!frobenius.empty()) frobenius[k] = frobenius_norm(jacobian).to_float_rounded();
        if (!spectral.empty()) store_norms(k, jacobian);
    }
    if (rows.submitted == rows.gradients.size()) finish_gradients(rows, n + 1);
}

void Pipeline::Workspace::compare_row(SoaDistances& rows, int n) {
    std::uint8_t* const of_row = mask.data() + extents.index(0, n);
    rows.mark_row(n, of_row);
    if (!gradient.empty() && !emd_bounds) {
        float* const gradients = gradient.data() + extents.index(0, n);
        rows.compare_row(n, gradients, of_row);
    }
    if (!frobenius.empty()) rows.slopes_row(n, frobenius.data() + extents.index(0, n), of_row);
    if (spectral.empty()) return;
    for (int m = 0; m < extents.m; ++m)
        store_norms(extents.index(m, n), (of_row[m] & kNoGradient) == 0 ? rows.jacobian(m, n) : Jacobian{});
}

// Solves the submitted EMD gradients and writes them to the map; `last` is the row after theirs.
void Pipeline::Workspace::finish_gradients(EmdRows& rows, int last) {
    rows.solver.finish();
    float* out = gradient.data() + extents.index(0, last) - rows.submitted;
    for (std::size_t k = 0; k < rows.submitted; ++k) out[k] = static_cast<float>(rows.gradients[k].norm());
    rows.submitted = 0;
}

void Pipeline::Workspace::store_norms(std::size_t k, const Jacobian& jacobian) {
    const SingularNorms norms = singular_norms(jacobian);
    spectral[k] = norms.spectral.to_float_rounded();
    nuclear[k] = norms.nuclear.to_float_rounded();
    anisotropy[k] = norms.anisotropy.to_float_rounded();
}

}  // namespace hord::algo
