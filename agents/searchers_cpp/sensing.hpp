// What a search knows when it is asked: was there gas since it was asked last, where, and whence the wind.
#pragma once

#include <deque>
#include <numeric>
#include <utility>

#include "common.hpp"

// The sum of numbers without what rounding loses on the way, as Python's math.fsum gives it (Shewchuk 1997).
inline double exact_sum(const std::vector<double>& numbers) {
    std::vector<double> parts;
    for (double x : numbers) {
        std::size_t kept = 0;
        for (double part : parts) {
            if (std::abs(x) < std::abs(part)) std::swap(x, part);
            const double sum = x + part, rest = part - (sum - x);
            if (rest != 0.0) parts[kept++] = rest;
            x = sum;
        }
        parts.resize(kept);
        parts.push_back(x);
    }
    return std::accumulate(parts.begin(), parts.end(), 0.0);
}

inline double mean_of(const std::vector<double>& numbers) {
    return exact_sum(numbers) / static_cast<double>(numbers.size());
}

inline double distance_m(const Vec3& a, const Vec3& b) {
    return std::hypot(std::hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

// Tells from the slope of ln R when a MOX sensor meets gas; see hits.OnsetDetector of the Python package.
class Onset {
public:
    explicit Onset(double smoothing_s = 1.0, double least_slope_per_s = 0.005)
        : smoothing_s_{smoothing_s}, least_per_s_{least_slope_per_s}, threshold_per_s_{least_slope_per_s} {}

    bool add(double time_s, double ohm) {
        if (std::isfinite(ohm) && ohm > 0.0) {
            const double log_ohm = std::log(ohm);
            if (!smooth_) {
                smooth_ = last_log_ = log_ohm;
                first_s_ = last_s_ = time_s;
            } else if (time_s - last_s_ > 1e-9) {
                follow(log_ohm, time_s - last_s_);
                last_s_ = time_s;
                last_log_ = log_ohm;
            }
        }
        return is_onset();
    }

    bool is_onset() const { return last_s_ - first_s_ >= 2.0 && slope_per_s_ < -threshold_per_s_; }

    // Whether the sensor recovers from gas.
    bool is_offset() const { return last_s_ - first_s_ >= 2.0 && slope_per_s_ > threshold_per_s_; }

    std::optional<double> log_ohm() const { return smooth_; }

private:
    void follow(double log_ohm, double step_s) {
        const double weight = -std::expm1(-step_s / smoothing_s_);
        if (log_ohm != last_log_) {
            const double surprise = log_ohm - last_log_ - slope_per_s_ * step_s;
            n_changes_ += 1.0;
            const double share = std::max(-std::expm1(-step_s / 20.0), 1.0 / n_changes_);
            noise_variance_ += share * (surprise * surprise / 2.0 - noise_variance_);
        }
        slope_per_s_ = weight * (log_ohm - *smooth_) / step_s;
        *smooth_ += weight * (log_ohm - *smooth_);
        const double sd_per_s = weight * std::sqrt(noise_variance_ * 2.0 / (2.0 - weight)) / step_s;
        threshold_per_s_ = std::max(3.0 * sd_per_s, least_per_s_);
    }

    double smoothing_s_, least_per_s_, threshold_per_s_;
    std::optional<double> smooth_;
    double last_log_ = 0.0, slope_per_s_ = 0.0, noise_variance_ = 0.0, n_changes_ = 0.0, first_s_ = 0.0, last_s_ = 0.0;
};

// Tells gas, clean air and recovery apart by level and derivative; see MoxEvidence of the Python package.
class MoxEvidence {
public:
    bool add(double time_s, double ohm) {
        is_broken_ = !(std::isfinite(ohm) && ohm > 0.0);
        onset_.add(time_s, ohm);
        slow_.add(time_s, ohm);
        if (const auto smooth = slow_.log_ohm()) {
            const double before = baseline_.value_or(*smooth);
            baseline_ = *smooth + std::max(0.0, before - *smooth) * std::exp(-(time_s - last_s_) / 300.0);
        }
        last_s_ = time_s;
        return is_gas() && !is_broken_;
    }

    bool is_recovering() const {
        return is_broken_ || (level() > least_level && slow_.is_offset() && !onset_.is_onset());
    }

private:
    double level() const { return slow_.log_ohm() && baseline_ ? *baseline_ - *slow_.log_ohm() : 0.0; }
    bool is_gas() const { return onset_.is_onset() || (level() > least_level && !slow_.is_offset()); }

    static constexpr double least_level = 0.1;
    Onset onset_, slow_{3.0, 0.003};
    std::optional<double> baseline_;
    double last_s_ = 0.0;
    bool is_broken_ = false;
};

struct Wind {
    double x_m_s, y_m_s, upwind_rad;
};

// The first anemometer of the briefing.
class Vane {
public:
    explicit Vane(const json& briefing) {
        for (const auto& sensor : briefing.at("sensors"))
            if (sensor.at("quantity") == "apparent_wind") {
                name_ = sensor.at("name");
                is_3d_ = sensor.at("unit") == "m/s";
                return;
            }
        throw std::runtime_error("sensors: expected at least 1 of kind wind, was none");
    }

    // Nothing while the sensor warms up.
    std::optional<Wind> wind(const json& observation) const {
        const json& reading = reading_of(observation, name_);
        if (reading.value("is_warming_up", false)) return std::nullopt;
        const double first = reading.at("values").at(0), second = reading.at("values").at(1);
        if (is_3d_) return Wind{first, second, std::atan2(-second, -first)};
        return Wind{-first * std::cos(second), -first * std::sin(second), second};
    }

private:
    std::string name_;
    bool is_3d_ = false;
};

// What is known at a question; see contacts.Contact of the Python package.
struct Contact {
    bool has_gas;
    std::optional<Vec3> gas_m, last_m;
    std::optional<double> upwind_rad;
};

// Takes note of hits and wind at every observation; see plume_contact.PlumeContactDetector of the Python package.
class PlumeContactDetector {
public:
    PlumeContactDetector(const json& briefing, double threshold_ppm, double threshold_m_s)
        : nose_{briefing}, vane_{briefing}, threshold_m_s_{threshold_m_s} {
        threshold_ = nose_.unit() == "ppm" ? threshold_ppm : 0.5;
        lag_s_ = nose_.unit() == "ohm" ? 1.0 : 0.0;
    }

    // Takes note of an observation, once for each, and returns whether there is a hit at it.
    bool add(const json& observation) {
        const Vec3 here_m = observation.at("position_world_m");
        const double time_s = observation.at("time_s");
        feel(observation, here_m);
        track_.emplace_back(time_s, here_m);
        while (track_.size() > 1 && track_[1].first <= time_s - lag_s_) track_.pop_front();
        if (!nose_.is_ready(observation) || !is_hit(time_s, nose_.value(observation))) return false;
        last_m_ = track_.front().second;
        hits_m_.push_back(*last_m_);
        return true;
    }

    // What is known now; hits are collected anew.
    Contact contact() {
        trust_wind();
        std::optional<Vec3> gas_m;
        if (!hits_m_.empty()) {
            gas_m.emplace();
            for (std::size_t axis = 0; axis < 3; ++axis) {
                std::vector<double> column;
                for (const Vec3& place_m : hits_m_) column.push_back(place_m[axis]);
                (*gas_m)[axis] = mean_of(column);
            }
            hits_m_.clear();
        }
        return {gas_m.has_value(), gas_m, last_m_, upwind_rad_};
    }

private:
    bool is_hit(double time_s, double value) {
        return nose_.unit() == "ohm" ? mox_.add(time_s, value) : value > threshold_;
    }

    // Samples the wind of this hold; while the vehicle moves a hold has one sample.
    void feel(const json& observation, const Vec3& here_m) {
        const std::string status = observation.at("status");
        const bool is_at_rest = status == "holding" || status == "on_ground";
        if (!is_at_rest || !hold_at_m_ || distance_m(*hold_at_m_, here_m) > 0.25) {
            winds_.clear();
            hold_at_m_ = is_at_rest ? std::optional<Vec3>{here_m} : std::nullopt;
        }
        const auto wind = vane_.wind(observation);
        if (wind && nose_.is_ready(observation)) winds_.push_back(*wind);
    }

    // Remembers the mean direction of this hold's wind where it was strong enough to have one.
    void trust_wind() {
        std::vector<double> speeds_m_s, sines, cosines;
        for (const Wind& wind : winds_) {
            speeds_m_s.push_back(std::hypot(wind.x_m_s, wind.y_m_s));
            sines.push_back(std::sin(wind.upwind_rad));
            cosines.push_back(std::cos(wind.upwind_rad));
        }
        if (!winds_.empty() && mean_of(speeds_m_s) > threshold_m_s_)
            upwind_rad_ = std::atan2(mean_of(sines), mean_of(cosines));
    }

    Nose nose_;
    Vane vane_;
    MoxEvidence mox_;
    double threshold_m_s_, threshold_, lag_s_;
    std::deque<std::pair<double, Vec3>> track_;
    std::vector<Vec3> hits_m_;
    std::optional<Vec3> last_m_, hold_at_m_;
    std::vector<Wind> winds_;
    std::optional<double> upwind_rad_;
};
