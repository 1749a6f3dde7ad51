// How often a searcher meets gas of a source elsewhere; see encounters.EncounterModel of the Python package.
#pragma once

#include "common.hpp"

// The logarithm of the modified Bessel function of the second kind and order 0.
inline double log_k0(double x) {
    const double half = 0.5 * x;
    if (x > 2.0) {
        const double t = 2.0 / x;
        double scaled = 0.00053208;
        for (double c : {-0.00251540, 0.00587872, -0.01062446, 0.02189568, -0.07832358, 1.25331414})
            scaled = scaled * t + c;
        return std::log(scaled) - 0.5 * std::log(x) - x;
    }
    const double q = half * half, log_half = std::log(half);
    double psi = -0.5772156649015329, term = 1.0, total = psi - log_half;
    for (int k = 1; k <= 12; ++k) {
        term *= q / (k * k);
        psi += 1.0 / k;
        total += term * (psi - log_half);
    }
    return std::log(total);
}

// Particles that a steady, even wind carries off and eddies spread until they are gone.
struct Encounters {
    Vec2 drift_per_m;
    double length_m, nearest_m, log_strength;

    // The logarithm of the hits that a stop at a place expects of a source in a cell.
    double log_mean_hits(const Vec2& place_m, const Vec2& cell_m) const {
        const double dx = place_m[0] - cell_m[0], dy = place_m[1] - cell_m[1];
        const double d = std::max(std::sqrt(dx * dx + dy * dy), nearest_m);
        return log_strength + (drift_per_m[0] * dx + drift_per_m[1] * dy) + log_k0(d * (1.0 / length_m));
    }
};

// What a searcher supposes of any plume of its mission.
struct Dispersal {
    double hits_at_1m, diffusivity_m2_s, lifetime_s, room_length_m, detector_m, correlation_s, stop_s;

    // The encounters in a wind, with so many hits at 1 m downwind of the source as were supposed.
    Encounters model(const Vec2& wind_m_s, double spread_rad) const {
        const double speed_m_s = std::hypot(wind_m_s[0], wind_m_s[1]), meander_m_s = speed_m_s * spread_rad;
        const double spread_m2_s = diffusivity_m2_s + meander_m_s * meander_m_s * correlation_s;
        const double life_s = std::min(lifetime_s, room_length_m / std::max(speed_m_s, 0.02));
        const double gone = 1.0 + speed_m_s * speed_m_s * life_s / (4.0 * spread_m2_s);
        const double length_m = std::sqrt(spread_m2_s * life_s / gone);
        const double log_ratio = std::log(std::log(std::max(length_m / detector_m, 2.0)));
        const Vec2 drift_per_m{wind_m_s[0] / (2.0 * spread_m2_s), wind_m_s[1] / (2.0 * spread_m2_s)};
        Encounters model{drift_per_m, length_m, detector_m, std::log(stop_s) - log_ratio};
        Vec2 away{1.0, 0.0};
        if (speed_m_s != 0.0) away = {wind_m_s[0] / speed_m_s, wind_m_s[1] / speed_m_s};
        const double found = model.log_mean_hits(away, {0.0, 0.0});
        model.log_strength = std::log(std::exp(std::log(hits_at_1m) - found) * stop_s) - log_ratio;
        return model;
    }
};

// How likely no hit and a hit are for a place of the source, and what each weighs in a belief.
struct Outcomes {
    Vec2 likelihood, weight, log_weight;
};

// The outcomes of a stop: likelihoods with a floor, and weights tempered by a power.
inline Outcomes outcomes_of(double log_mean, double floor, double power) {
    Outcomes told{{1.0 - floor, floor}, {0.0, 0.0}, {power * std::log1p(-floor), 0.0}};
    if (log_mean < -40.0) {  // no hit is to be expected
        if (floor > 0.0) told.log_weight[1] = power * std::log(floor);
        told.weight = {std::exp(told.log_weight[0]), floor > 0.0 ? std::exp(told.log_weight[1]) : 0.0};
        return told;
    }
    const double mean = std::exp(std::min(log_mean, 50.0)), none = std::exp(-mean);
    const double some = mean < 1e-5 ? mean * (1.0 - 0.5 * mean) : 1.0 - none;
    told.likelihood = {floor + (1.0 - 2.0 * floor) * none, floor + (1.0 - 2.0 * floor) * some};
    for (std::size_t h = 0; h < 2; ++h) {
        const double chance = told.likelihood[h];
        told.log_weight[h] = chance > 0.0 ? power * std::log(chance) : 0.0;
        told.weight[h] = chance > 0.0 ? (power == 1.0 ? chance : std::exp(told.log_weight[h])) : 0.0;
    }
    return told;
}
