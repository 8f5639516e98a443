// Hooke's law in the small strain, for tests against linear theory:
//
//   e <- e + sym(dt grad v),   tau = 2 mu e + lambda tr(e) I
//
// It does not know rotations: a turn by an angle a strains it by a^2 / 2.
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct LinearElastic : IsotropicElastic {
    static constexpr const char* name = "LinearElastic";
    static constexpr const char* summary =
        "Hooke's law in the small strain; for rotations and strains of a few thousandths";
    static constexpr const char* source = "Hooke's law";
    static constexpr const char* needs = "elastic_strain";
    static constexpr bool stores_strain = true;  // the total one, which may be smoothed over cells
    static constexpr Column columns[] = {{"strain", {3, 6}, "small strain", "1"}};

    template <int D>
    static constexpr int reals = symmetric_reals<D>;

    template <class V, int D, class T>
    MPM_INLINE static void advance(V (&state)[reals<D>], const Mat<V, D>& strain,
                                   const Constants<T>&) {
        Mat<V, D> e = load_symmetric<D>(state);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            e.e[a][b] = e.e[a][b] + T(0.5) * (strain.e[a][b] + strain.e[b][a]);
        }
        store_symmetric<D>(state, e);
    }
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[reals<D>], const Mat<V, D>&,
                                          const Constants<T>& k) {
        Mat<V, D> tau = load_symmetric<D>(state);
        const V all = k.lame * trace(tau);
        MPM_UNROLL for (int a = 0; a < D; ++a) MPM_UNROLL for (int b = 0; b < D; ++b) {
            tau.e[a][b] = (T(2) * k.shear) * tau.e[a][b];
            if (a == b) tau.e[a][b] = tau.e[a][b] + all;
        }
        return tau;
    }
    /// Volume ratio 1 + tr(e) between 0.05 and 20, and all that is stored a number.
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        using T = ScalarOf<V>;
        V change = V(T(0));
        MPM_UNROLL for (int r = 0; r < D; ++r) change = change + state[r];
        MaskOf<V> fine = (V(T(-0.95)) < change) & (change < V(T(19)));
        MPM_UNROLL for (int r = D; r < reals<D>; ++r) fine = fine & is_finite(state[r]);
        return fine;
    }
    static constexpr const char* limits = "its volume ratio left the range 0.05 to 20";
    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[reals<D>]) {
        V loss = -state[0];
        MPM_UNROLL for (int r = 1; r < D; ++r) loss = loss - state[r];
        return loss;
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto k = Elasticity<double>::of(q[1], q[2]);
        const Mat<double, D> tau = kirchhoff<double, D, double>(own, Mat<double, D>{}, k),
                             e = load_symmetric<D>(own);
        Observation<D> o{};
        o.volume_ratio = 1 + trace(e);
        double squares = 0;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b < D; ++b) {
                o.stress[a][b] = tau.e[a][b] / o.volume_ratio;
                o.deformation[a][b] = a == b ? 1.0 : 0.0;
                squares += e.e[a][b] * e.e[a][b];
            }
        o.pressure = -k.bulk() * trace(e) / o.volume_ratio;
        o.elastic_energy = k.shear * squares + 0.5 * k.lame * trace(e) * trace(e);
        return o;
    }
};

}  // namespace mpm
