// Sand and gravel: Drucker-Prager yield in the logarithmic strain with cohesion, dilatancy, a
// tension cut-off and volume correction (Klar et al. 2016; Tampubolon et al. 2017; Bonus 2023,
// section 5.7), the cone through the corners of Mohr-Coulomb's in triaxial compression.
//
//   p = -K tr(e),  s = 2 mu dev(e)
//   f = |s| - 3 alpha p - k <= 0,   alpha = sqrt(2/3) 2 sin(phi) / (3 - sin(phi)),
//                                   k = sqrt(2/3) 6 c cos(phi) / (3 - sin(phi))
//   flow: g = |s| - 3 alpha' p with the dilatancy angle for phi:
//     d gamma = f / (2 mu + 9 K alpha alpha'),  |s| <- |s| - 2 mu d gamma,
//     p <- p + 3 K alpha' d gamma
//   tension: p >= -p_t, the cut-off, at most the apex c cot(phi). What the volume opens beyond that
//     is kept as a gap, which must close before the material is compressed again.
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct DruckerPrager : HenckyFlow<DruckerPrager> {
    static constexpr const char* name = "DruckerPrager";
    static constexpr const char* summary =
        "Sand: Drucker-Prager yield with cohesion, dilatancy and tension cut-off";
    static constexpr const char* source =
        "Klár et al. (2016); Tampubolon et al. (2017); Bonus (2023), section 5.7";
    static constexpr Column columns[] = {
        elastic_column,
        {"plastic_strain", {1, 1}, "accumulated equivalent plastic shear strain", "1"},
        {"gap", {1, 1}, "logarithmic volume opened in tension that is still to close", "1"},
        {"dilation", {1, 1}, "logarithmic volume gained for good", "1"}};
    static constexpr Parameter parameters[] = {
        solid_density,
        youngs_modulus,
        poissons_ratio,
        {"friction_angle", "φ", "°", 30.0, 0.0, 89.0, false, false,
         "friction angle in triaxial compression, degrees"},
        {"cohesion", "c", "Pa", 0.0, 0.0, unbounded, false, true, "cohesion"},
        {"dilatancy_angle", "ψ", "°", 0.0, 0.0, 89.0, false, false,
         "dilatancy angle, degrees; below the friction angle in soils"},
        {"tension_cutoff", "p_t", "Pa", 0.0, 0.0, unbounded, false, true,
         "largest mean tension; the apex c cot φ bounds it in any case"},
        {"volume_correction", "β", "1", 1.0, 0.0, 1.0, false, false,
         "share of what opened in tension that must close again"},
    };

    template <class T>
    struct Constants {
        Elasticity<T> elastic;
        T bulk;            // K
        T friction;        // 3 alpha
        T cohesion;        // k
        T dilation;        // 3 alpha'
        T compliance;      // 1 / (2 mu + 9 K alpha alpha')
        T tension;         // p_t
        T tension_strain;  // p_t / K
        T correction;
    };
    /// sqrt(2/3) 6 / (3 - sin(angle)); times sin(angle) it is 3 alpha, times c cos(angle) k.
    MPM_HD static double cone(double degrees) {
        return std::sqrt(2.0 / 3) * 6 / (3 - std::sin(degrees * degree));
    }
    template <class T>
    static Constants<T> constants(const double* p) {
        const auto e = Elasticity<double>::of(p[1], p[2]);
        const double bulk = e.bulk();
        const double friction = cone(p[3]) * std::sin(p[3] * degree),
                     cohesion = cone(p[3]) * p[4] * std::cos(p[3] * degree),
                     dilation = cone(p[5]) * std::sin(p[5] * degree);
        const double tension = cutoff(p);
        return {{T(e.shear), T(e.lame)},
                T(bulk),
                T(friction),
                T(cohesion),
                T(dilation),
                T(1 / (2 * e.shear + bulk * friction * dilation)),
                T(tension),
                T(tension / bulk),
                T(p[7])};
    }

    /// B in the plane, in two dimensions the strain out of the plane, plastic strain, gap,
    /// dilation.
    template <int D>
    static constexpr int reals = D == 2 ? 7 : 9;
    template <int D>
    static constexpr int sheared = reals<D> - 3;
    template <int D>
    static constexpr int opened = reals<D> - 2;
    template <int D>
    static constexpr int gained = reals<D> - 1;

    /// Advances the state and returns the Kirchhoff stress.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> respond(V (&state)[reals<D>], const Mat<V, D>& strain,
                                        const Constants<T>& k) {
        const V zero = V(T(0));
        const Mat<V, D> trial = advance_left_cauchy_green(load_symmetric<D>(state), strain);
        LogStrain<V, D> s = log_strain(trial, D == 2 ? state[3] : zero);
        const Vec<V, 3> dev = s.deviator();
        const V size = norm(dev), twice = V(T(2) * k.elastic.shear);
        const V gap = state[opened<D>];
        const V elastic_volume = s.volumetric(),
                volume = elastic_volume + gap;  // as if the gap were strain
        const V pressure = -k.bulk * volume;

        const auto torn = V(k.tension_strain) < volume;
        const V over = twice * size - k.friction * pressure - k.cohesion;
        const auto shears = zero < over;
        const V flow = select(shears, k.compliance * over, zero);
        const V cone_volume = volume - k.dilation * flow, cone_size = size - flow;
        const V most = (T(1) / twice) * (k.cohesion - V(k.friction * k.tension));
        const V torn_size = select(size < most, size, larger(most, zero));
        const V new_volume = select(torn, V(k.tension_strain), cone_volume),
                new_size = select(torn, torn_size, cone_size);

        // A deviator whose square has vanished is kept.
        const V part = select(zero < size, new_size, V(T(1))) / select(zero < size, size, V(T(1)));
        const V mean = T(1.0 / 3) * new_volume;
        MPM_UNROLL for (int i = 0; i < 3; ++i) s.e[i] = mean + part * dev[i];
        // What neither opened nor slid, nor closes a gap, is elastic: its B is the trial's.
        const auto changed = torn | shears | (zero < gap);
        HenckyFlow::template keep<D>(state, changed, trial, s);
        // Of what opens now a share stays for good; what closes closes all of it.
        const V change = elastic_volume - new_volume, widens = larger(change, zero);
        const V kept = select(torn, k.correction * widens + (change - widens), -gap);
        state[sheared<D>] = state[sheared<D>] + T(equivalent_share) * (size - new_size);
        state[gained<D>] =
            state[gained<D>] + select(torn, (T(1) - k.correction) * widens, k.dilation * flow);
        state[opened<D>] = gap + kept;
        return hencky_stress(s, k.elastic);
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        using T = ScalarOf<V>;
        const V hard = state[sheared<D>], gap = state[opened<D>], gain = state[gained<D>];
        return HenckyFlow::template admissible_strain<D>(state) & (V(T(-1)) < hard) &
               (hard < V(T(1e6))) & (absolute(gap) < V(T(1e6))) & (absolute(gain) < V(T(1e6)));
    }
    static constexpr const char* limits =
        "its elastic volume ratio left the range 0.05 to 20, or a plastic strain 1e6";
    template <int D, class V>
    MPM_INLINE static V volume_loss(const V (&state)[reals<D>]) {
        const V flowed = state[opened<D>] + state[gained<D>];
        return volume_loss_of(load_symmetric<D>(state), D == 2 ? state[3] + flowed : flowed);
    }

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto s = elastic_strain<D>(own);
        const auto e = Elasticity<double>::of(q[1], q[2]);
        Observation<D> o =
            observe_hencky<D>(s, e, std::exp(s.volumetric() + own[opened<D>] + own[gained<D>]));
        o.plastic_strain = own[sheared<D>];
        const double size = 2 * e.shear * norm(s.deviator()), p = -e.bulk() * s.volumetric(),
                     limit = cone(q[3]) *
                             (std::sin(q[3] * degree) * p + q[4] * std::cos(q[3] * degree));
        const double scale = 1e-5 * (std::fabs(p) + size + q[4]);
        o.yields = own[opened<D>] > 0 || (o.plastic_strain > 0 && size > limit - scale);
        return o;
    }

private:
    static constexpr double degree = 3.14159265358979323846 / 180;
    /// Largest mean tension, Pa.
    MPM_HD static double cutoff(const double* p) {
        const double sine = std::sin(p[3] * degree);
        const double apex = sine > 0 ? p[4] * std::cos(p[3] * degree) / sine : unbounded;
        return p[6] < apex ? p[6] : apex;
    }
};

}  // namespace mpm
