#include "lab/experiment/transport_check.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace hord::lab {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

std::vector<int> lit(const Masses& h) {
    std::vector<int> bins;
    for (std::size_t k = 0; k < h.size(); ++k) {
        if (h[k] > 0) bins.push_back(static_cast<int>(k));
    }
    return bins;
}

std::int64_t total(const Masses& h) { return std::accumulate(h.begin(), h.end(), std::int64_t{0}); }

// Rows supply, columns demand. Sends flow along shortest paths of the residual graph until all is delivered.
class ShortestPaths {
  public:
    ShortestPaths(const Masses& a, const Masses& b, const algo::GroundDistance& ground)
        : row_bins_(lit(a)), col_bins_(lit(b)) {
        const std::int64_t sum_a = total(a), sum_b = total(b);
        rows_ = row_bins_.size();
        cols_ = col_bins_.size();
        for (const int p : row_bins_) supply_.push_back(a[static_cast<std::size_t>(p)] * sum_b);
        for (const int q : col_bins_) demand_.push_back(b[static_cast<std::size_t>(q)] * sum_a);
        cost_.resize(rows_ * cols_);
        for (std::size_t i = 0; i < rows_; ++i) {
            for (std::size_t j = 0; j < cols_; ++j) cost_[i * cols_ + j] = ground(row_bins_[i], col_bins_[j]);
        }
        flow_.assign(rows_ * cols_, 0);
        potential_.assign(rows_ + cols_, 0);
    }

    double solve() {
        while (deliver_once()) {
        }
        double work = 0;
        for (std::size_t k = 0; k < flow_.size(); ++k) work += static_cast<double>(flow_[k]) * cost_[k];
        return work;
    }

  private:
    // False when all is delivered.
    bool deliver_once() {
        const std::size_t nodes = rows_ + cols_;
        std::vector<double> far(nodes, kFar);
        std::vector<std::size_t> from(nodes, nodes);
        std::vector<bool> done(nodes, false);
        for (std::size_t i = 0; i < rows_; ++i) far[i] = supply_[i] > 0 ? 0 : kFar;
        std::size_t target = nodes;
        for (;;) {
            std::size_t next = nodes;
            for (std::size_t v = 0; v < nodes; ++v) {
                if (!done[v] && far[v] < kFar && (next == nodes || far[v] < far[next])) next = v;
            }
            if (next == nodes) return false;
            done[next] = true;
            if (next >= rows_ && demand_[next - rows_] > 0) {
                target = next;
                break;
            }
            relax(next, far, from, done);
        }
        for (std::size_t v = 0; v < nodes; ++v) potential_[v] += std::min(far[v], far[target]);
        push(target, from);
        return true;
    }

    void relax(std::size_t node, std::vector<double>& far, std::vector<std::size_t>& from,
               const std::vector<bool>& done) {
        const auto offer = [&](std::size_t to, double length) {
            const double way = far[node] + std::max(0.0, length + potential_[node] - potential_[to]);
            if (done[to] || way >= far[to]) return;
            far[to] = way;
            from[to] = node;
        };
        if (node < rows_) {
            for (std::size_t j = 0; j < cols_; ++j) offer(rows_ + j, cost_[node * cols_ + j]);
        } else {
            for (std::size_t i = 0; i < rows_; ++i) {
                if (flow_[i * cols_ + node - rows_] > 0) offer(i, -cost_[i * cols_ + node - rows_]);
            }
        }
    }

    void push(std::size_t target, const std::vector<std::size_t>& from) {
        const std::size_t nodes = rows_ + cols_;
        std::int64_t amount = demand_[target - rows_];
        std::size_t start = target;
        for (; from[start] != nodes; start = from[start]) {
            if (start < rows_) amount = std::min(amount, flow_[start * cols_ + from[start] - rows_]);
        }
        amount = std::min(amount, supply_[start]);
        for (std::size_t v = target; from[v] != nodes; v = from[v]) {
            if (v < rows_) {
                flow_[v * cols_ + from[v] - rows_] -= amount;
            } else {
                flow_[from[v] * cols_ + v - rows_] += amount;
            }
        }
        supply_[start] -= amount;
        demand_[target - rows_] -= amount;
    }

    std::vector<int> row_bins_, col_bins_;
    std::size_t rows_ = 0, cols_ = 0;
    std::vector<std::int64_t> supply_, demand_, flow_;
    std::vector<double> cost_, potential_;
};

// ln of the sum of exponentials.
double log_sum(const std::vector<double>& terms) {
    const double most = *std::max_element(terms.begin(), terms.end());
    double sum = 0;
    for (const double t : terms) sum += std::exp(t - most);
    return most + std::log(sum);
}

}  // namespace

double distance_by_shortest_paths(const Masses& a, const Masses& b, const algo::GroundDistance& ground) {
    return ShortestPaths(a, b, ground).solve() / (static_cast<double>(total(a)) * static_cast<double>(total(b)));
}

Sinkhorn sinkhorn(const Masses& a, const Masses& b, const algo::GroundDistance& ground, double epsilon,
                  double wanted_residual, int most_rounds) {
    const std::vector<int> rows = lit(a), cols = lit(b);
    const auto share = [](const Masses& h, int bin) {
        return h[static_cast<std::size_t>(bin)] / static_cast<double>(total(h));
    };
    std::vector<double> f(rows.size()), g(cols.size()), terms;
    const auto exponent = [&](std::size_t i, std::size_t j) {
        return (f[i] + g[j] - ground(rows[i], cols[j])) / epsilon;
    };

    Sinkhorn result;
    result.bias = epsilon * std::log(static_cast<double>(rows.size() * cols.size()));
    result.residual = kFar;
    while (result.rounds < most_rounds && result.residual > wanted_residual) {
        ++result.rounds;
        for (std::size_t i = 0; i < rows.size(); ++i) {
            terms.clear();
            for (std::size_t j = 0; j < cols.size(); ++j) terms.push_back(exponent(i, j));
            f[i] += epsilon * (std::log(share(a, rows[i])) - log_sum(terms));
        }
        for (std::size_t j = 0; j < cols.size(); ++j) {
            terms.clear();
            for (std::size_t i = 0; i < rows.size(); ++i) terms.push_back(exponent(i, j));
            g[j] += epsilon * (std::log(share(b, cols[j])) - log_sum(terms));
        }
        result.cost = result.residual = 0;
        for (std::size_t i = 0; i < rows.size(); ++i) {
            double sent = 0;
            for (std::size_t j = 0; j < cols.size(); ++j) {
                const double moved = std::exp(exponent(i, j));
                sent += moved;
                result.cost += moved * ground(rows[i], cols[j]);
            }
            result.residual += std::abs(sent - share(a, rows[i]));
        }
    }
    return result;
}

}  // namespace hord::lab
