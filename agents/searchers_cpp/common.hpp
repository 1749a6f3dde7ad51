// What all methods of this folder share: random numbers, lengths, instruments, parameters, legs.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

using json = nlohmann::json;
using Vec2 = std::array<double, 2>;
using Vec3 = std::array<double, 3>;

constexpr double full_turn_rad = 6.283185307179586;
constexpr int n_tries = 100;

// Lengths are rounded to whole millimetres, so that the last bit of sin and cos has no effect.
inline double to_millimetre(double length_m) { return std::floor(length_m * 1000.0 + 0.5) / 1000.0; }

// SplitMix64.
class RandomStream {
public:
    explicit RandomStream(std::uint64_t seed) : state_{seed} {}

    // The next random number in [0, 1).
    double fraction() {
        std::uint64_t z = state_ += 0x9E3779B97F4A7C15;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
        return static_cast<double>((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
    }

    double angle_rad() { return full_turn_rad * fraction(); }
    double uniform(double low, double high) { return low + (high - low) * fraction(); }

private:
    std::uint64_t state_;
};

// The settings of the briefing; one that this method does not know is refused.
class Parameters {
public:
    Parameters(const json& briefing, const std::set<std::string>& known)
        : values_(briefing.value("parameters", json::object())) {
        for (const auto& item : values_.items())
            if (known.count(item.key()) == 0)
                throw std::runtime_error("parameters." + item.key() + ": this method in C++ has no such parameter");
    }

    double number(const char* name, double usual) const { return values_.value(name, usual); }

    bool flag(const char* name, bool usual) const { return values_.value(name, usual); }
    std::size_t whole(const char* name, std::size_t usual) const { return values_.value(name, usual); }

    // One of several words, the first where none is given.
    std::string choice(const char* name, const std::vector<std::string>& choices) const {
        const std::string given = values_.value(name, choices.front());
        if (std::find(choices.begin(), choices.end(), given) == choices.end())
            throw std::runtime_error(std::string{"parameters."} + name + ": expected " + json(choices).dump());
        return given;
    }

    // Nothing where it is not given, or null: the vehicle holds as long as the briefing says.
    std::optional<double> number_if_given(const char* name) const {
        return values_.contains(name) && !values_.at(name).is_null() ? std::optional<double>{values_.at(name).get<double>()} : std::nullopt;
    }

    // Refuses a scenario in which the Python method would declare the source.
    void require_no_declarations() const {
        if (values_.value("declares", true))
            throw std::runtime_error("parameters.declares: expected false, because this method in C++ never declares");
    }

    // Of what the Python method can do in several ways, one is done here.
    void require(const char* name, const json& only) const {
        if (values_.contains(name) && values_.at(name) != only)
            throw std::runtime_error(std::string{"parameters."} + name + ": expected " + only.dump() + ", was " +
                                     values_.at(name).dump());
    }

private:
    json values_;
};

// The room without its margin; where there is less than two margins, its middle.
struct Room {
    Vec2 min_m, max_m;

    Room(const json& briefing, double margin_m) {
        const auto& bounds = briefing.at("bounds");
        for (std::size_t axis = 0; axis < 2; ++axis) {
            const double low_m = bounds.at("min_m").at(axis), high_m = bounds.at("max_m").at(axis);
            const double middle_m = (low_m + high_m) / 2.0;
            min_m[axis] = std::min(low_m + margin_m, middle_m);
            max_m[axis] = std::max(high_m - margin_m, middle_m);
        }
    }

    bool contains(const Vec2& point_m) const {
        for (std::size_t axis = 0; axis < 2; ++axis)
            if (point_m[axis] < min_m[axis] || point_m[axis] > max_m[axis]) return false;
        return true;
    }

    // The nearest place inside, in whole millimetres.
    Vec2 nearest(const Vec2& point_m) const {
        return {to_millimetre(std::clamp(point_m[0], min_m[0], max_m[0])),
                to_millimetre(std::clamp(point_m[1], min_m[1], max_m[1]))};
    }

    // The end of a leg, or nothing where it would come too close to a wall.
    std::optional<Vec2> leg_end(const Vec2& start_m, double heading_rad, double length_m) const {
        const Vec2 end_m{to_millimetre(start_m[0] + length_m * std::cos(heading_rad)),
                         to_millimetre(start_m[1] + length_m * std::sin(heading_rad))};
        return contains(end_m) ? std::optional<Vec2>{end_m} : std::nullopt;
    }
};

inline const json& reading_of(const json& observation, const std::string& sensor) {
    for (const auto& item : observation.at("readings"))
        if (item.at("sensor") == sensor) return item;
    throw std::runtime_error("no reading of " + sensor);
}

// The first gas sensor of the briefing.
class Nose {
public:
    explicit Nose(const json& briefing) {
        const std::set<std::string> quantities{"resistance", "mixing_ratio", "gas_detected", "hits"};
        for (const auto& sensor : briefing.at("sensors"))
            if (quantities.count(sensor.at("quantity")) != 0) {
                name_ = sensor.at("name");
                unit_ = sensor.at("unit");
                return;
            }
        throw std::runtime_error("sensors: expected at least 1 of kind gas, was none");
    }

    bool is_ready(const json& observation) const { return !reading_of(observation, name_).value("is_warming_up", false); }

    const std::string& unit() const { return unit_; }

    // The reading as it is.
    double value(const json& observation) const { return reading_of(observation, name_).at("values").at(0); }

    // Grows with the gas: the conductance of a sensor in ohm, what others show.
    double amount(const json& observation) const {
        const double value = this->value(observation);
        if (unit_ != "ohm") return value;
        return value > 0.0 ? 1.0 / value : std::numeric_limits<double>::infinity();
    }

private:
    std::string name_, unit_;
};

inline Vec2 place_of(const json& observation) {
    const auto& position_m = observation.at("position_world_m");
    return {position_m.at(0), position_m.at(1)};
}

inline bool has_notice(const json& observation) {
    return observation.contains("notice") && !observation["notice"].is_null();
}

inline json waypoint(const json& observation, const Vec2& place_m, double height_m, std::optional<double> hold_s) {
    json command{{"tick", observation.at("tick")},
                 {"kind", "waypoint"},
                 {"position_world_m", {place_m[0], place_m[1], height_m}}};
    if (hold_s) command["hold_s"] = *hold_s;
    return command;
}

// A search method: it is made of the briefing, sees every observation, and answers those that ask.
class Method {
public:
    virtual ~Method() = default;
    virtual void observe(const json&) {}
    virtual json decide(const json& observation) = 0;
};
