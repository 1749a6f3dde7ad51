// The dung beetle in C++: JSON lines on standard input and output, read and written with nlohmann/json.
// The rules and the exact arithmetic are those of ../dung_beetle/README.md.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>

namespace {

using json = nlohmann::json;
using Vec2 = std::array<double, 2>;

constexpr double leg_m = 0.8;
constexpr double wall_margin_m = 1.0;
constexpr double right_angle_rad = 1.5707963267948966;
constexpr double zigzag_rad = 1.0471975511965976;
constexpr double half_turn_rad = 3.141592653589793;
constexpr double full_turn_rad = 6.283185307179586;
constexpr int n_random_headings = 100;

// Lengths are rounded to whole millimetres, so that the last bit of sin and cos has no effect.
double to_millimetre(double length_m) { return std::floor(length_m * 1000.0 + 0.5) / 1000.0; }

// SplitMix64.
class Random {
public:
    explicit Random(std::uint64_t seed) : state_{seed} {}

    // The next random number in [0, 1).
    double fraction() {
        std::uint64_t z = state_ += 0x9E3779B97F4A7C15;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
        return static_cast<double>((z ^ (z >> 31)) >> 11) / 9007199254740992.0;
    }

private:
    std::uint64_t state_;
};

std::string sensor_with(const json& briefing, const char* key, const char* wanted) {
    for (const auto& sensor : briefing.at("sensors"))
        if (sensor.at(key) == wanted) return sensor.at("name");
    throw std::runtime_error(std::string{"no sensor whose "} + key + " is " + wanted);
}

double reading(const json& observation, const std::string& sensor, std::size_t index) {
    for (const auto& item : observation.at("readings"))
        if (item.at("sensor") == sensor) return item.at("values").at(index);
    throw std::runtime_error("no reading of " + sensor);
}

// Seeks gas across the wind, then zigzags up the wind; all it remembers is one reading and its side.
class DungBeetle {
public:
    explicit DungBeetle(const json& briefing)
        : nose_{sensor_with(briefing, "unit", "ohm")},
          vane_{sensor_with(briefing, "model", "anemometer")},
          height_m_{briefing.at("search_height_m")},
          random_{briefing.at("seed").get<std::uint64_t>()} {
        const std::string version = briefing.at("contract_version");
        if (version.rfind("1.", 0) != 0) throw std::runtime_error("expected contract version 1, was " + version);
        const auto& bounds = briefing.at("bounds");
        for (std::size_t axis = 0; axis < 2; ++axis) {
            min_m_[axis] = bounds.at("min_m").at(axis).get<double>() + wall_margin_m;
            max_m_[axis] = bounds.at("max_m").at(axis).get<double>() - wall_margin_m;
        }
    }

    // The answer to an observation that awaits one: the next leg.
    json decide(const json& observation) {
        const double ohm = reading(observation, nose_, 0);
        const double upwind_rad = reading(observation, vane_, 1);
        const bool has_more_gas = last_ohm_ && ohm < *last_ohm_;
        last_ohm_ = ohm;
        if (side_ == 0)
            side_ = has_more_gas ? 1 : 0;
        else if (!has_more_gas)
            side_ = -side_;

        const auto& position_m = observation.at("position_world_m");
        const bool is_blocked = observation.contains("notice") && !observation["notice"].is_null();
        const Vec2 goal_m = next_waypoint({position_m.at(0), position_m.at(1)}, upwind_rad, is_blocked);
        return {{"tick", observation.at("tick")},
                {"kind", "waypoint"},
                {"position_world_m", {goal_m[0], goal_m[1], height_m_}}};
    }

private:
    // The end of the first possible leg: the rule's own, then what is left at a wall; without one, leaves the margin.
    Vec2 next_waypoint(const Vec2& start_m, double upwind_rad, bool is_blocked) {
        if (side_ == 0) {
            if (!is_blocked)
                if (auto leg = leg_to(start_m, upwind_rad + right_angle_rad)) return *leg;
        } else {
            if (auto leg = leg_to(start_m, upwind_rad + side_ * zigzag_rad)) return *leg;
            side_ = -side_;
            if (auto leg = leg_to(start_m, upwind_rad + side_ * zigzag_rad)) return *leg;
            if (auto leg = leg_to(start_m, upwind_rad + half_turn_rad)) return *leg;
        }
        for (int i = 0; i < n_random_headings; ++i)
            if (auto leg = leg_to(start_m, full_turn_rad * random_.fraction())) return *leg;
        return {to_millimetre(std::clamp(start_m[0], min_m_[0], max_m_[0])),
                to_millimetre(std::clamp(start_m[1], min_m_[1], max_m_[1]))};
    }

    // The end of a leg in this direction, or nothing where it would come too close to a wall.
    std::optional<Vec2> leg_to(const Vec2& start_m, double heading_rad) const {
        const Vec2 goal_m{to_millimetre(start_m[0] + leg_m * std::cos(heading_rad)),
                          to_millimetre(start_m[1] + leg_m * std::sin(heading_rad))};
        for (std::size_t axis = 0; axis < 2; ++axis)
            if (goal_m[axis] < min_m_[axis] || goal_m[axis] > max_m_[axis]) return std::nullopt;
        return goal_m;
    }

    std::string nose_, vane_;
    Vec2 min_m_{}, max_m_{};
    double height_m_;
    Random random_;
    std::optional<double> last_ohm_;
    int side_ = 0;  // 0 seeking, +1 zigzagging left of upwind, -1 right of it
};

void fly() {
    std::optional<DungBeetle> beetle;
    for (std::string line; std::getline(std::cin, line);) {
        const json message = json::parse(line);
        const std::string kind = message.at("message");
        if (kind == "Ending") return;
        if (kind == "Briefing")
            beetle.emplace(message);
        else if (message.value("awaiting_command", false))
            std::cout << beetle.value().decide(message) << std::endl;  // endl also flushes: the run waits for it
    }
}

}  // namespace

int main() {
    std::ios::sync_with_stdio(false);
    try {
        fly();
    } catch (const std::exception& error) {
        std::cerr << "dung_beetle_cpp: " << error.what() << '\n';
        return EXIT_FAILURE;
    }
}
