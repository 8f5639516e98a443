// Clay, snow and other porous solids: Cam-Clay with a flow that keeps the volume on the flanks of
// its yield surface (non-associative; Gaume et al. 2018; Wolper et al. 2019). Pressures are
// Kirchhoff's and positive in compression, J is the elastic volume ratio, plane strain is three
// dimensions with one stretch that stands still.
//
//   Psi = mu/2 (J^(-2/3) tr b - 3) + K/2 ((J^2 - 1)/2 - ln J)
//   p = -K/2 (J^2 - 1),   s = mu J^(-2/3) dev b,   q = sqrt(3/2) |s|
//   y = (1 + 2 beta) q^2 + M^2 (p + beta p0) (p - p0) <= 0,   M = 6 sin(phi) / (3 - sin(phi))
//   p0 = K (1e-5 + sinh(xi max(-alpha, 0)))
//
// Return of a trial state, by the case it is in with the p0 of the step's start:
//   crushed, p > p0:        p <- p0,       s <- 0, alpha <- alpha + ln(J_trial / J)
//   torn,    p < -beta p0:  p <- -beta p0, s <- 0, alpha likewise
//   sheared, y > 0:         s shrinks to y = 0 at the same p; alpha <- alpha + ln(J_trial / J*),
//     J* that of p*, where the line from the ellipse's centre to the trial (p, q) leaves it
// The papers take p0 from the start of the step. So does this law where it softens. Where it
// hardens p0 is that of the end: from the start it overshoots, and for xi above 1 or so errors of
// rounding grow from step to step.
//
// Every return lowers Psi, so that no step gains energy. At constant pressure and for beta < 1 the
// surface moves until p is its centre, the critical state
//   q / p = M (1 + beta) / ((1 - beta) sqrt(1 + 2 beta)).
#pragma once

#include "mpm/physics/material/elasticity.hpp"

namespace mpm {

struct CamClay {
    static constexpr const char* name = "CamClay";
    static constexpr const char* summary =
        "Clay or snow: non-associative Cam-Clay with cohesion, hardening and softening";
    static constexpr bool fused = false;
    static constexpr const char* source = "Gaume et al. (2018); Wolper et al. (2019)";
    static constexpr const char* needs = "elastic_strain";
    static constexpr bool volumetric = false;
    static constexpr Column columns[] = {
        {"B", {4, 6}, "elastic left Cauchy-Green tensor less 1; 2D: with its zz entry last", "1"},
        {"plastic_strain", {1, 1}, "accumulated equivalent plastic strain, volume included", "1"},
        {"consolidation", {1, 1}, "change of α; negative: harder than at the start", "1"},
        {"dilation", {1, 1}, "logarithmic volume gained for good", "1"}};
    static constexpr Parameter parameters[] = {
        solid_density,
        youngs_modulus,
        poissons_ratio,
        {"log_plastic_volume", "α₀", "1", required, -unbounded, 0.0, true, true,
         "initial consolidation α, the logarithm of the plastic volume ratio; the pressure of "
         "first crushing is p₀ = K (10⁻⁵ + sinh(-ξ α₀)), K = E / (3 (1 - 2 ν))"},
        {"friction_angle", "φ", "°", 30.0, 0.0, 89.0, true, false,
         "friction angle in triaxial compression, degrees"},
        {"cohesion_ratio", "β", "1", 0.5, 0.0, unbounded, false, true,
         "largest mean tension in parts of p₀"},
        {"hardening_factor", "ξ", "1", 0.8, 0.0, unbounded, true, true,
         "growth of p₀ with the consolidation"},
        {"hardens", "h", "1", 1.0, 0.0, 1.0, false, false,
         "share of the flow that changes α: 1 hardens and softens, 0 keeps p₀"},
    };

    /// Pressures in parts of the bulk modulus: their products stay in range in single precision.
    template <class T>
    struct Constants {
        T shear;      // mu
        T bulk;       // K
        T slope;      // sqrt(3/2) mu / K
        T strain;     // K / (3 mu)
        T friction;   // M
        T cohesion;   // beta
        T flatness;   // 1 + 2 beta
        T hardening;  // xi
        T start;      // alpha at the start
        T share;      // h
    };
    template <class T>
    MPM_HD static Constants<T> constants(const double* p) {
        const auto e = Elasticity<double>::of(p[1], p[2]);
        const double sine = std::sin(p[4] * degree), bulk = e.bulk();
        return {T(e.shear),
                T(bulk),
                T(std::sqrt(1.5) * e.shear / bulk),
                T(bulk / (3 * e.shear)),
                T(6 * sine / (3 - sine)),
                T(p[5]),
                T(1 + 2 * p[5]),
                T(p[6]),
                T(p[3]),
                T(p[7])};
    }
    static double density(const double* p) { return p[0]; }
    /// At zero strain. The bulk stiffness is K J^2: below K in compression; in tension at most
    /// K + 2 beta p0.
    static double wave_speed(const double* p) { return pressure_wave_speed(p[1], p[2], p[0]); }

    /// B, in two dimensions with zz, plastic strain, consolidation, dilation.
    template <int D>
    static constexpr int reals = D == 2 ? 7 : 9;
    template <int D>
    static constexpr int sheared = reals<D> - 3;
    template <int D>
    static constexpr int hardened = reals<D> - 2;
    template <int D>
    static constexpr int gained = reals<D> - 1;

    /// Advances the state and returns the Kirchhoff stress.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> respond(V (&state)[reals<D>], const Mat<V, D>& strain,
                                        const Constants<T>& k) {
        const V zero = V(T(0)), one = V(T(1));
        const Mat<V, D> trial = advance_left_cauchy_green(load_symmetric<D>(state), strain);
        const V trial_out = out_of_plane<D>(state);
        const Parts<V, D> b = parts(trial, trial_out);
        const V alpha = k.start + state[hardened<D>];
        Surface<V, T> at(b, k, crushing(alpha, k.hardening));
        const MaskOf<V> crushed = at.p0 < at.p, torn = at.p < -k.cohesion * at.p0;
        const MaskOf<V> bursts = crushed | torn, shears = (at.bound(k) < at.q) & !bursts;
        const MaskOf<V> flows = bursts | shears;
        const V first = select(flows, k.share * at.change(crushed, torn, k), zero);
        const V change = harden(at, first, alpha, crushed, torn, k);

        const V edge = at.bound(k), tip = at.tip(crushed, k);
        const V kept = select(
            bursts, zero, select(shears, smaller(edge / select(zero < at.q, at.q, one), one), one));
        const V opened = select(bursts, at.change(crushed, torn, k), zero);

        // The new b: the deviator shrinks, its mean keeps the volume.
        const V burst = expm1_of(T(1.0 / 3) * (b.logarithm - T(2) * opened));
        const V top = b.root() + kept * (b.mean - b.root());
        const V mean = select(bursts, burst,
                              mean_of(kept * kept * b.square, kept * kept * kept * b.determinant,
                                      b.volume, top, shears));
        Mat<V, D> b_new;
        MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
            const V entry = kept * b.dev.e[i][j];
            b_new.e[i][j] = select(flows, i == j ? entry + mean : entry, trial.e[i][j]);
        }
        store_symmetric<D>(state, b_new);
        if constexpr (D == 2) state[3] = select(flows, kept * b.out + mean, trial_out);

        const V slid = k.strain * (at.q - kept * at.q);
        state[sheared<D>] =
            state[sheared<D>] + square_root(slid * slid + T(2.0 / 9) * (opened * opened));
        state[hardened<D>] = state[hardened<D>] + change;
        state[gained<D>] = state[gained<D>] + opened;
        return stress(b, kept, select(bursts, tip, b.volume), k);
    }
    template <class V, int D, class T = ScalarOf<V>, class Constants>
    MPM_INLINE static void advance(V (&state)[reals<D>], const Mat<V, D>& strain,
                                   const Constants& k) {
        respond<V, D, T>(state, strain, k);
    }
    template <class V, int D, class T = ScalarOf<V>, class Constants>
    MPM_INLINE static Mat<V, D> kirchhoff(const V (&state)[reals<D>], const Mat<V, D>&,
                                          const Constants& k) {
        const Parts<V, D> b = parts(load_symmetric<D>(state), out_of_plane<D>(state));
        return stress(b, V(T(1)), b.volume, k);
    }
    template <class V, int D>
    MPM_INLINE static MaskOf<V> admissible(const V (&state)[reals<D>]) {
        using T = ScalarOf<V>;
        const Mat<V, D> b = load_symmetric<D>(state);
        const V out = out_of_plane<D>(state), volume = parts(b, out).volume;
        MaskOf<V> fine = is_finite(out) & (V(T(-1 + least)) < volume) & (volume < V(T(399)));
        MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j <= i; ++j) {
            fine = fine & is_finite(b.e[i][j]);
        }
        const V hard = state[hardened<D>], gain = state[gained<D>], flow = state[sheared<D>];
        return fine & (V(T(-1)) < flow) & (flow < V(T(1e6))) & (absolute(hard) < V(T(1e6))) &
               (absolute(gain) < V(T(1e6)));
    }
    static constexpr const char* limits =
        "its elastic volume ratio left the range 0.05 to 20, or a plastic strain 1e6";

    template <int D>
    MPM_HD static Observation<D> observe(const double* state, const double (&)[D][D],
                                         const double* q) {
        double own[reals<D>];
        for (int r = 0; r < reals<D>; ++r) own[r] = state[r];
        const auto e = Elasticity<double>::of(q[1], q[2]);
        const auto b = parts(load_symmetric<D>(own), out_of_plane<D>(own));
        Observation<D> o{};
        const double J = std::exp(0.5 * b.logarithm + own[gained<D>]), small = b.unimodular();
        const double pressure = -0.5 * e.bulk() * b.volume;
        o.volume_ratio = J;
        o.pressure = pressure / J;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j < D; ++j) {
                const double shear = e.shear * small * b.dev.e[i][j];
                o.stress[i][j] = (shear - (i == j ? pressure : 0.0)) / J;
                o.deformation[i][j] = i == j ? 1.0 : 0.0;
            }
        // tr(J^(-2/3) b) - 3 is of the second order in the strain; as a difference it would not be.
        const double excess =
            mean_of(small * small * b.square, small * small * small * b.determinant, 0.0,
                    small * b.mean + b.shrink, true);
        o.elastic_energy = 1.5 * e.shear * excess + 0.25 * e.bulk() * (b.volume - b.logarithm);
        o.plastic_strain = own[sheared<D>];
        // y in parts of its least, at the centre.
        const auto k = constants<double>(q);
        const Surface<double, double> at(b, k, crushing(k.start + own[hardened<D>], k.hardening));
        const double edge = at.slack(k), radius = at.radius(k);
        o.yields =
            o.plastic_strain > 0 && k.flatness * at.q * at.q - edge > -1e-5 * (radius * radius);
        return o;
    }

private:
    static constexpr double degree = 3.14159265358979323846 / 180;
    static constexpr double least = 0.0025;  // of J^2

    /// What the law reads off b = I + B; all of them small where the strain is small.
    template <class V, int D>
    struct Parts {
        Mat<V, D> dev;
        V out;          // of the deviator, out of the plane
        V mean;         // tr B / 3
        V square;       // |dev b|^2
        V determinant;  // det dev b
        V volume;       // J^2 - 1
        V logarithm;    // 2 ln J
        V shrink;       // J^(-2/3) - 1
        MPM_INLINE V unimodular() const { return shrink + ScalarOf<V>(1); }
        MPM_INLINE V root() const { return -shrink / unimodular(); }  // J^(2/3) - 1
    };
    template <class V, int D>
    MPM_INLINE static Parts<V, D> parts(const Mat<V, D>& b, V out) {
        using T = ScalarOf<V>;
        Parts<V, D> x;
        x.mean = T(1.0 / 3) * (D == 2 ? trace(b) + out : trace(b));
        x.out = out - x.mean;
        x.square = V(T(0));
        MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
            x.dev.e[i][j] = i == j ? b.e[i][j] - x.mean : b.e[i][j];
            x.square = x.square + x.dev.e[i][j] * x.dev.e[i][j];
        }
        const V plane = determinant(x.dev, cofactors(x.dev)), swept = volume_change(b);
        if constexpr (D == 2) {
            x.square = x.square + x.out * x.out;
            x.determinant = plane * x.out;
            x.volume = swept + (out + swept * out);
        } else {
            x.determinant = plane;
            x.volume = swept;
        }
        x.logarithm = log1p_of(x.volume);
        x.shrink = expm1_of(T(-1.0 / 3) * x.logarithm);
        return x;
    }
    template <int D, class V>
    MPM_INLINE static V out_of_plane(const V (&state)[reals<D>]) {
        return D == 2 ? state[3] : V(ScalarOf<V>(0));
    }
    /// Kirchhoff stress of b with `kept` of its deviator and the J^2 - 1 given.
    template <class V, int D, class T>
    MPM_INLINE static Mat<V, D> stress(const Parts<V, D>& b, V kept, V volume,
                                       const Constants<T>& k) {
        const V shear = (k.shear * kept) * b.unimodular(), all = (T(0.5) * k.bulk) * volume;
        Mat<V, D> tau;
        MPM_UNROLL for (int i = 0; i < D; ++i) MPM_UNROLL for (int j = 0; j < D; ++j) {
            const V entry = shear * b.dev.e[i][j];
            tau.e[i][j] = i == j ? entry + all : entry;
        }
        return tau;
    }
    /// A trial state and the yield surface of a p0, pressures in parts of K.
    template <class V, class T>
    struct Surface {
        V volume, p, q, p0;
        template <int D>
        MPM_INLINE Surface(const Parts<V, D>& b, const Constants<T>& k, V crush)
            : volume(b.volume),
              p(T(-0.5) * b.volume),
              q(k.slope * b.unimodular() * square_root(b.square)),
              p0(crush) {}
        MPM_INLINE V radius(const Constants<T>& k) const {
            return (T(0.5) * k.friction) * (p0 + k.cohesion * p0);
        }
        /// M^2 (p + beta p0) (p0 - p)
        MPM_INLINE V slack(const Constants<T>& k) const {
            return (k.friction * k.friction) * ((p + k.cohesion * p0) * (p0 - p));
        }
        /// The q at which y = 0.
        MPM_INLINE V bound(const Constants<T>& k) const {
            return square_root(larger(slack(k), V(T(0))) * (T(1) / k.flatness));
        }
        /// J^2 - 1 at the tip on the state's side.
        MPM_INLINE V tip(MaskOf<V> crushed, const Constants<T>& k) const {
            return select(crushed, T(-2) * p0, (T(2) * k.cohesion) * p0);
        }
        /// ln(J_trial / J), or ln(J_trial / J*): p* = p + aside, J* kept off zero. The share of the
        /// way to the centre comes from y: as a difference it would lose its digits.
        MPM_INLINE V change(MaskOf<V> crushed, MaskOf<V> torn, const Constants<T>& k) const {
            const V zero = V(T(0)), centre = T(0.5) * (p0 - k.cohesion * p0), edge = bound(k);
            const V off = k.friction * (p - centre), square = k.flatness * (q * q) + off * off;
            const V reach = square_root(select(zero < square, square, V(T(1))));
            const V beyond = larger(k.flatness * ((q - edge) * (q + edge)), zero);
            const V share = beyond / (reach * (reach + radius(k)));
            const V aside = T(2) * (share * (centre - p)), whole = volume + T(1);
            const V star = smaller(aside, whole - T(least)) / larger(whole - aside, V(T(least)));
            const V end = tip(crushed, k);
            const V burst = (volume - end) / larger(end + T(1), V(T(least)));
            return T(0.5) * log1p_of(select(crushed | torn, burst, star));
        }
    };
    /// The change of alpha, and in `at` the p0 of the return: those of the start where alpha grows,
    /// else those at which the change is that of its own p0. They lie between none and `first`, and
    /// are found by false position (Illinois), every third step by halving.
    template <class V, class T>
    MPM_INLINE static V harden(Surface<V, T>& at, V first, V alpha, MaskOf<V> crushed,
                               MaskOf<V> torn, const Constants<T>& k) {
        const V zero = V(T(0)), begin = at.p0;
        constexpr int most = 60;
        constexpr T share = sizeof(T) == 4 ? T(1e-5) : T(1e-13),
                    digit = std::numeric_limits<T>::epsilon();
        const V still = share * absolute(first) + digit * (absolute(at.volume) + absolute(alpha));
        const MaskOf<V> hardens = first < -still;
        MaskOf<V> active = hardens, was_above = hardens;
        V x = first, low = first, high = zero, at_low = -still, at_high = -first;
        for (int n = 0; any(active); ++n) {
            at.p0 = select(hardens, crushing(alpha + x, k.hardening), begin);
            const V miss = x - k.share * at.change(crushed, torn, k);
            active = active & (still < absolute(miss));
            if (n == most || !any(active)) break;
            // An end that is kept twice weighs half.
            const MaskOf<V> above = zero < miss, again = above & was_above,
                            below_again = !(above | was_above);
            low = select(above, low, x);
            high = select(above, x, high);
            at_low = select(above, select(again, T(0.5) * at_low, at_low), miss);
            at_high = select(above, miss, select(below_again, T(0.5) * at_high, at_high));
            was_above = above;
            const V apart = at_high - at_low;
            const V line = at_high / select(zero < apart, apart, V(T(1)));
            const V part = n % 3 == 2 ? V(T(0.5)) : line;  // far ends mislead the line
            x = select(active, high - part * (high - low), x);
        }
        return x;
    }
    /// p0 / K. No pressure reaches K / 2, so that what lies far above need not grow.
    template <class V, class T>
    MPM_INLINE static V crushing(V alpha, T hardening) {
        const V x = expm1_of(smaller(hardening * larger(-alpha, V(T(0))), V(T(20))));
        return T(0.5) * (x + x / (x + T(1))) + T(1e-5);
    }
    /// The y for which a tensor of mean 1 + y and of the deviator given has the determinant
    /// 1 + volume, by Newton's steps from a `top` above it, where the cubic is convex.
    template <class V>
    MPM_INLINE static V mean_of(V square, V determinant, V volume, V top, MaskOf<V> active) {
        using T = ScalarOf<V>;
        constexpr T still = sizeof(T) == 4 ? T(1e-5) : T(1e-9);  // the error after is its square
        const V half = T(0.5) * square, constant = determinant - half - volume;
        V y = top;
        for (int k = 0; k < 40; ++k) {
            const V value = ((y + T(3)) * y + (T(3) - half)) * y + constant;
            const V slope = T(3) * ((y + T(1)) * (y + T(1))) - half;
            const V step = value / slope;
            y = select(active, y - step, y);
            active = active & (still * (y + T(1)) < absolute(step));
            if (!any(active)) break;
        }
        return y;
    }
};

}  // namespace mpm
