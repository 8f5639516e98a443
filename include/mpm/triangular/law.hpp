// A material of the library as this method uses it: in double precision, two dimensions, one
// particle at a time. Which material it is costs one indirect call a particle here, where a
// particle reads and adds to nine functions.
#pragma once

#include <algorithm>
#include <iterator>
#include <memory>
#include <string_view>

#include "mpm/physics/material/elasticity.hpp"

namespace mpm::triangular {

using Tensor = Mat<double, 2>;

class Law {
public:
    Law() = default;
    Law(const Law&) = delete;
    Law& operator=(const Law&) = delete;
    virtual ~Law() = default;

    virtual int reals() const = 0;
    /// Advances the state by `strain` = dt grad v and returns the Kirchhoff stress, Pa.
    virtual Tensor respond(double* state, const Tensor& strain, const Tensor& rate) const = 0;
    /// Kirchhoff stress of a state at rest.
    virtual Tensor stress(const double* state) const = 0;
    virtual bool admissible(const double* state) const = 0;
    virtual Observation<2> observe(const double* state, const Tensor& rate) const = 0;
    /// Of small strains from rest.
    virtual Elasticity<double> elasticity() const = 0;
};

template <class Material>
class LawOf final : public Law {
public:
    static constexpr int count = Material::template reals<2>;

    explicit LawOf(const double* parameters)
        : constants_(Material::template constants<double>(parameters)) {
        std::copy(parameters, parameters + std::size(Material::parameters), parameters_);
    }
    int reals() const override { return count; }
    Tensor respond(double* state, const Tensor& strain, const Tensor& rate) const override {
        Own own(state);
        Tensor tau;
        if constexpr (Responds<Material, double, 2, double>) {
            tau = Material::respond(own.e, strain, constants_);
        } else {
            Material::advance(own.e, strain, constants_);
            tau = Material::kirchhoff(own.e, rate, constants_);
        }
        std::copy(own.e, own.e + count, state);
        return tau;
    }
    Tensor stress(const double* state) const override {
        const Own own(state);
        return Material::kirchhoff(own.e, Tensor{}, constants_);
    }
    bool admissible(const double* state) const override {
        const Own own(state);
        return Material::template admissible<double, 2>(own.e);
    }
    Observation<2> observe(const double* state, const Tensor& rate) const override {
        return Material::template observe<2>(state, rate.e, parameters_);
    }
    Elasticity<double> elasticity() const override {
        if constexpr (std::string_view(Material::parameters[1].name) == youngs_modulus.name) {
            return Elasticity<double>::of(parameters_[1], parameters_[2]);
        } else {
            const double c = Material::wave_speed(parameters_);
            return {0.0, Material::density(parameters_) * c * c};
        }
    }

private:
    struct Own {
        double e[count];
        explicit Own(const double* state) { std::copy(state, state + count, e); }
    };
    typename Material::template Constants<double> constants_;
    double parameters_[std::size(Material::parameters)];
};

}  // namespace mpm::triangular
