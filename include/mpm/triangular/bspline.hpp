// B-splines on a line: piecewise polynomials on repeated knots, de Koster (2018) section 3.4.
#pragma once

#include <vector>

namespace mpm::triangular {

/// The functions N_i, i < count(), of one degree on open knots: non-negative, of sum 1, and at a
/// knot of multiplicity r with degree - r continuous derivatives. Spans are those between knots
/// that differ, numbered from the left; degree + 1 functions live on each.
class BSpline {
public:
    static constexpr int highest = 5;

    /// Throws SceneError for a degree above `highest`, knots that fall, end knots that are not
    /// repeated degree + 1 times, and inner ones of which a function would jump.
    BSpline(std::vector<double> knots, int degree);
    /// Equal spans of [lower, upper], all functions as smooth as they can be.
    static BSpline open(double lower, double upper, int spans, int degree);

    int degree() const { return degree_; }
    int count() const { return int(knots_.size()) - degree_ - 1; }
    int spans() const { return int(breaks_.size()) - 1; }
    const std::vector<double>& knots() const { return knots_; }
    /// Knots without repetition: span s is from number s to s + 1.
    const std::vector<double>& breaks() const { return breaks_; }
    double lower() const { return breaks_.front(); }
    double upper() const { return breaks_.back(); }

    /// Span of a place, -1 outside. A knot belongs to the span on its right, the last one to the
    /// last span, and what is outside by rounding to the span next to it.
    int span(double x) const;
    /// The first of the degree + 1 functions that live on a span.
    int first(int span) const { return first_[std::size_t(span)]; }
    /// Values and derivatives of those functions.
    void evaluate(int span, double x, double* value, double* derivative) const;

    /// Greville points g with sum g_i N_i(x) = x. For degree 0, which has no such points, the
    /// middle of the spans.
    std::vector<double> greville() const;

private:
    std::vector<double> knots_, breaks_;
    std::vector<int> first_;
    int degree_;
};

}  // namespace mpm::triangular
