#include "mpm/kernels/cpu/smooth_points.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpm::cpu {

namespace {

/// Occupied cells, or corners of them, in ascending order, and their neighbours.
template <int D>
struct Lattice {
    using Key = std::array<std::int64_t, D>;
    std::vector<Key> keys;

    void close() {
        std::sort(keys.begin(), keys.end());
        keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
    }
    std::int64_t find(const Key& k) const {
        const auto at = std::lower_bound(keys.begin(), keys.end(), k);
        return at != keys.end() && *at == k ? at - keys.begin() : -1;
    }
};

struct Listed {
    const std::int64_t* neighbours;
    int sides;
    std::int64_t operator()(std::int64_t c, int axis, int side) const {
        return neighbours[c * sides + 2 * axis + side];
    }
};

double energy(const PointField& p, const double* field) {
    double sum = 0;
    for (std::int64_t k = 0; k < p.count; ++k) {
        for (int q = 0; q < p.components; ++q) {
            const double v = field[k * p.components + q];
            sum += p.mass[k] * v * v;
        }
    }
    return sum;
}

double uniform_energy(const PointField& p, const double* field) {
    double sum = 0;
    for (int q = 0; q < p.components; ++q) {
        double mass = 0, moment = 0;
        for (std::int64_t k = 0; k < p.count; ++k) {
            mass += p.mass[k];
            moment += p.mass[k] * field[k * p.components + q];
        }
        sum += moment * moment / mass;
    }
    return sum;
}

/// Mass-weighted means at the corners by the cells' linear functions, lumped, and back: NB.
template <int D>
class Corners {
public:
    Corners(const PointField& p, const std::vector<typename Lattice<D>::Key>& cell,
            const std::vector<Vec<double, D>>& x)
        : points_(p), corner_(std::size_t(p.count) << D), weight_(corner_.size()) {
        Lattice<D> lattice;
        const auto of = [&](std::int64_t k, int c) {
            auto key = cell[std::size_t(k)];
            for (int a = 0; a < D; ++a) key[std::size_t(a)] += c >> a & 1;
            return key;
        };
        for (std::int64_t k = 0; k < p.count; ++k)
            for (int c = 0; c < 1 << D; ++c) lattice.keys.push_back(of(k, c));
        lattice.close();
        mass_.assign(lattice.keys.size(), 0.0);
        for (std::int64_t k = 0; k < p.count; ++k) {
            for (int c = 0; c < 1 << D; ++c) {
                const std::size_t at = (std::size_t(k) << D) + std::size_t(c);
                corner_[at] = lattice.find(of(k, c));
                double w = 1;
                for (int a = 0; a < D; ++a) w *= 0.5 + (c >> a & 1 ? 1 : -1) * x[std::size_t(k)][a];
                weight_[at] = w;
                mass_[std::size_t(corner_[at])] += w * p.mass[k];
            }
        }
    }
    void smooth(double* field) {
        for (int q = 0; q < points_.components; ++q) {
            sum_.assign(mass_.size(), 0.0);
            const auto value = [&](std::int64_t k) -> double& {
                return field[k * points_.components + q];
            };
            for (std::size_t at = 0; at < corner_.size(); ++at) {
                const auto k = std::int64_t(at >> D);
                sum_[std::size_t(corner_[at])] += weight_[at] * points_.mass[k] * value(k);
            }
            for (std::int64_t k = 0; k < points_.count; ++k) {
                double v = 0;
                for (int c = 0; c < 1 << D; ++c) {
                    const std::size_t at = (std::size_t(k) << D) + std::size_t(c),
                                      node = std::size_t(corner_[at]);
                    if (mass_[node] > 0) v += weight_[at] * sum_[node] / mass_[node];
                }
                value(k) = v;
            }
        }
    }

private:
    const PointField& points_;
    std::vector<std::int64_t> corner_;
    std::vector<double> weight_, mass_, sum_;
};

template <int D>
std::vector<SmoothingEnergy> smooth(const PointField& p, const SmoothingChoice& choice, int passes,
                                    double* field) {
    using Key = typename Lattice<D>::Key;
    std::vector<Key> cell(static_cast<std::size_t>(p.count));
    std::vector<Vec<double, D>> x(cell.size());
    Lattice<D> lattice;
    for (std::size_t k = 0; k < cell.size(); ++k) {
        for (int a = 0; a < D; ++a) {
            const double at = p.position[k * D + std::size_t(a)] / p.cell_size;
            const double low = std::floor(at);
            cell[k][std::size_t(a)] = std::int64_t(low);
            x[k][a] = at - low - 0.5;
        }
    }
    lattice.keys = cell;
    lattice.close();
    const std::int64_t cells = std::int64_t(lattice.keys.size());
    std::vector<std::int64_t> number(cell.size()), neighbours(std::size_t(cells) * 2 * D);
    for (std::size_t k = 0; k < cell.size(); ++k) number[k] = lattice.find(cell[k]);
    for (std::int64_t c = 0; c < cells; ++c) {
        for (int s = 0; s < 2 * D; ++s) {
            Key key = lattice.keys[std::size_t(c)];
            key[std::size_t(s / 2)] += s % 2 ? 1 : -1;
            neighbours[std::size_t(c * 2 * D + s)] = lattice.find(key);
        }
    }
    std::vector<SmoothingEnergy> energies;
    const int columns = CellColumns<D>::columns(choice, p.components);
    std::vector<double> data;
    for (int pass = 0; pass < passes; ++pass) {
        SmoothingEnergy e;
        e.before = energy(p, field);
        e.uniform = uniform_energy(p, field);
        if (choice.form == CellForm::nodal) {
            Corners<D>(p, cell, x).smooth(field);
        } else if (choice.form != CellForm::none) {
            data.assign(std::size_t(columns) * std::size_t(cells), 0.0);
            const auto at = CellColumns<D>::by_cell(data.data(), choice, p.components);
            for (std::size_t k = 0; k < cell.size(); ++k) {
                add_to_cell(at, number[k], p.mass[k], x[k],
                            [&](int q) { return field[k * std::size_t(p.components) + q]; });
            }
            const FinishCell<D> finish{at};
            const ExchangeCells<D, Listed> exchange{at, choice, {neighbours.data(), 2 * D}};
            for (std::int64_t c = 0; c < cells; ++c) finish(c);
            for (std::int64_t c = 0; choice.exchanges() && c < cells; ++c) exchange(c);
            for (std::size_t k = 0; k < cell.size(); ++k) {
                for (int q = 0; q < p.components; ++q)
                    field[k * std::size_t(p.components) + q] =
                        value_in_cell(at, number[k], x[k], q);
            }
        }
        e.after = energy(p, field);
        energies.push_back(e);
    }
    return energies;
}

}  // namespace

std::vector<SmoothingEnergy> smooth_points(const PointField& points, const SmoothingChoice& choice,
                                           int passes, double* field) {
    if (points.dimension == 1) return smooth<1>(points, choice, passes, field);
    if (points.dimension == 2) return smooth<2>(points, choice, passes, field);
    return smooth<3>(points, choice, passes, field);
}

}  // namespace mpm::cpu
