// F-bar for materials that store a volume ratio: the volume that the pressure sees is blended with
// the grid's average (Bonus 2023, sections 5.7-5.10; forms and first measurements in
// design/fbar.md). psi is the share of the average.
//
//   own      = the particle's j advanced by its own rate
//   average  = the gathered grid average, advanced by the same rate ("predictor": no lag)
//
//   one volume     stored = deposited = pressure = (1 - psi) own + psi average;
//                  psi = 1 - exp(-dt/tau) makes it a relaxation with time tau. With `carry` the
//                  gathered gradient of j goes into the deposit, an affine transfer of the volume,
//                  which removes the diffusion of a plain average.
//   two volumes    own and blended volume are both stored; the blended one is deposited and gives
//                  the pressure. Its fixed point is a Helmholtz filter of length
//                  (dx/2) sqrt(psi/(1-psi)) whatever dt.
//   stress only    own is stored and deposited; only the pressure sees the blend. For
//                  reproduction of published runs.
//   split          as two volumes, but the grid averages the blended volume advanced by this step's
//                  rate, with a transfer of its own (eqs. 5.54, 5.59).
//   literal        as two volumes, but the grid averages what the step before advanced (eqs.
//                  5.65-5.66): the pressure is a step late. For reproduction alone.
#pragma once

#include "mpm/core/linalg.hpp"

namespace mpm {

enum class Smoothing : int { none = 0, one_volume = 1, two_volumes = 2 };

template <class T>
struct SmoothingNumbers {
    T ratio;           // psi
    T carry;           // 1: deposit the gradient, 0: do not
    bool stress_only;  // uniform over the body
    // Of the forms that only the phased step has:
    bool lags = false;   // the average comes already advanced, or is a step old
    bool leads = false;  // what is deposited is advanced by this step's rate once more
};

template <class V, int D>
struct SmoothedVolume {
    V stored;     // the particle's own volume loss
    V blended;    // what the pressure sees
    V deposited;  // what the grid averages next
    Vec<V, D> slope;
};

/// `own` is already advanced; `average` is advanced here by `advance(average)`.
template <class V, int D, class T>
MPM_INLINE SmoothedVolume<V, D> smooth_volume(Smoothing form, V own, V advanced_average,
                                              const Vec<V, D>& gradient,
                                              const SmoothingNumbers<T>& k) {
    SmoothedVolume<V, D> out;
    out.blended = own + k.ratio * (advanced_average - own);
    out.stored = form == Smoothing::two_volumes || k.stress_only ? own : out.blended;
    out.deposited = k.stress_only ? own : out.blended;
    MPM_UNROLL for (int a = 0; a < D; ++a) out.slope[a] = k.carry * gradient[a];
    return out;
}

}  // namespace mpm
