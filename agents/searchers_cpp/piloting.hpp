// From a place where a search wants to go to a leg that can be flown; a leash against eddies; squares not seen yet.
#pragma once

#include <deque>

#include "common.hpp"
#include "sensing.hpp"

constexpr double right_angle_rad = 1.5707963267948966;

inline double length_m(const Vec2& start_m, const Vec2& end_m) {
    return std::hypot(end_m[0] - start_m[0], end_m[1] - start_m[1]);
}

// Flies legs to places, and never a refused leg again as it was; see piloting.Pilot of the Python package.
class Pilot {
public:
    Room room;
    RandomStream draws;

    Pilot(const json& briefing, double margin_m)
        : room{briefing, margin_m},
          draws{briefing.at("seed").get<std::uint64_t>()},
          height_m_{briefing.at("search_height_m")} {}

    // Whether the vehicle tells that it did not do as it was asked.
    bool was_refused(const json& observation) const { return has_notice(observation) && end_m_; }

    // Whether a leg towards a place leads anywhere before it meets the margin of the room.
    bool is_worth_it(const json& observation, const Vec2& target_m) const {
        const Vec2 start_m = place_of(observation);
        return length_m(start_m, cut_end_m(start_m, target_m)) >= 0.1;
    }

    // The command for a leg to a place, or as near to it as can be flown.
    json leg(const json& observation, const Vec2& target_m, std::optional<double> hold_s) {
        end_m_ = end_of_leg_m(place_of(observation), target_m, was_refused(observation) ? end_m_ : std::nullopt);
        return waypoint(observation, *end_m_, height_m_, hold_s);
    }

private:
    static constexpr double same_end_m = 0.02;

    Vec2 end_of_leg_m(const Vec2& start_m, const Vec2& target_m, const std::optional<Vec2>& refused_m) {
        const double wanted_m = length_m(start_m, target_m);
        if (wanted_m < same_end_m && !refused_m) return {to_millimetre(start_m[0]), to_millimetre(start_m[1])};
        const auto may_be = [&](const std::optional<Vec2>& end_m) {
            return end_m && !(refused_m && length_m(*end_m, *refused_m) < same_end_m);
        };
        auto end_m = shortened_end_m(start_m, target_m);
        if (may_be(end_m)) return *end_m;
        const double towards_rad = std::atan2(target_m[1] - start_m[1], target_m[0] - start_m[0]);
        for (double turn_rad : {right_angle_rad / 2.0, -right_angle_rad / 2.0, right_angle_rad, -right_angle_rad})
            if (end_m = room.leg_end(start_m, towards_rad + turn_rad, wanted_m); may_be(end_m)) return *end_m;
        for (int i = 0; i < n_tries; ++i)
            if (end_m = room.leg_end(start_m, draws.angle_rad(), wanted_m); may_be(end_m)) return *end_m;
        return room.nearest(start_m);
    }

    std::optional<Vec2> shortened_end_m(const Vec2& start_m, const Vec2& target_m) const {
        const Vec2 aim_m = cut_end_m(start_m, target_m);
        const double dx_m = aim_m[0] - start_m[0], dy_m = aim_m[1] - start_m[1];
        const double heading_rad = std::atan2(dy_m, dx_m);
        for (int i = 0; i <= 10; ++i) {
            const double shorter_m = std::hypot(dx_m, dy_m) - i * 0.05;
            if (shorter_m <= 0.0) return std::nullopt;
            if (auto end_m = room.leg_end(start_m, heading_rad, shorter_m)) return end_m;
        }
        return std::nullopt;
    }

    // The last place on the straight way to a target that lies inside the room's margin.
    Vec2 cut_end_m(const Vec2& start_m, const Vec2& target_m) const {
        double t = 1.0;
        for (std::size_t axis = 0; axis < 2; ++axis) {
            const double start = start_m[axis], target = target_m[axis];
            const double low = room.min_m[axis], high = room.max_m[axis];
            if (!(low <= start && start <= high)) return room.nearest(target_m);
            if (target > high) t = std::min(t, (high - start) / (target - start));
            if (target < low) t = std::min(t, (low - start) / (target - start));
        }
        return {start_m[0] + t * (target_m[0] - start_m[0]), start_m[1] + t * (target_m[1] - start_m[1])};
    }

    double height_m_;
    std::optional<Vec2> end_m_;
};

// The places of the last legs; it is wound up when all of them lie close together. 0 legs switch it off.
class Leash {
public:
    Leash(std::size_t n_legs, double radius_m) : n_legs_{n_legs}, radius_m_{radius_m} {}

    // Takes note of where a leg has ended; returns whether it is wound up, and lets go if so.
    bool pulls(const Vec2& place_m) {
        places_m_.push_back(place_m);
        if (places_m_.size() > n_legs_) places_m_.pop_front();
        if (n_legs_ == 0 || places_m_.size() < n_legs_) return false;
        std::vector<double> xs_m, ys_m;
        for (const Vec2& place : places_m_) xs_m.push_back(place[0]), ys_m.push_back(place[1]);
        const Vec2 mean_m{mean_of(xs_m), mean_of(ys_m)};
        for (const Vec2& place : places_m_)
            if (length_m(place, mean_m) > radius_m_) return false;
        places_m_.clear();
        return true;
    }

private:
    std::size_t n_legs_;
    double radius_m_;
    std::deque<Vec2> places_m_;
};

// Which squares of a room were not visited; see unseen.UnseenSquares of the Python package.
class UnseenSquares {
public:
    UnseenSquares(const Room& room, double edge_m)
        : columns_m_{middles_m(room.min_m[0], room.max_m[0], edge_m)},
          rows_m_{middles_m(room.min_m[1], room.max_m[1], edge_m)},
          radius_m_{edge_m / 2.0},
          is_seen_(columns_m_.size() * rows_m_.size(), false) {}

    // Takes the square around a place for seen: where the vehicle is, or one that it cannot reach.
    void note(const Vec2& place_m, bool is_there) {
        const std::size_t i = nearest(columns_m_, place_m[0]), j = nearest(rows_m_, place_m[1]);
        const bool is_near = std::hypot(columns_m_[i] - place_m[0], rows_m_[j] - place_m[1]) < radius_m_;
        if (is_near || !is_there) is_seen_[i * rows_m_.size() + j] = true;
    }

    // The centre of the next square to visit: rather beside the vehicle than up or down the wind.
    Vec2 next_place_m(const Vec2& here_m, std::optional<double> upwind_rad) {
        if (std::find(is_seen_.begin(), is_seen_.end(), false) == is_seen_.end())
            is_seen_.assign(is_seen_.size(), false);
        const double along_x = std::cos(upwind_rad.value_or(0.0)), along_y = std::sin(upwind_rad.value_or(0.0));
        Vec2 best_m{columns_m_[0], rows_m_[0]};
        double best_m2 = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < is_seen_.size(); ++k) {
            if (is_seen_[k]) continue;
            const Vec2 place_m{columns_m_[k / rows_m_.size()], rows_m_[k % rows_m_.size()]};
            const double dx_m = place_m[0] - here_m[0], dy_m = place_m[1] - here_m[1];
            const double along_m = 2.0 * (dx_m * along_x + dy_m * along_y), across_m = dy_m * along_x - dx_m * along_y;
            const double distance_m2 = across_m * across_m + along_m * along_m;
            // A micrometre decides nothing: the last bit of a sine does not choose the way.
            if (distance_m2 < best_m2 - 1e-6) best_m = place_m, best_m2 = distance_m2;
        }
        return best_m;
    }

private:
    static std::vector<double> middles_m(double low_m, double high_m, double edge_m) {
        const double n = std::max(1.0, std::ceil((high_m - low_m) / edge_m - 1e-9));
        std::vector<double> places_m;
        for (double i = 0.0; i < n; ++i) places_m.push_back(low_m + (high_m - low_m) * (i + 0.5) / n);
        return places_m;
    }

    static std::size_t nearest(const std::vector<double>& places_m, double place_m) {
        const auto is_nearer = [&](double a, double b) { return std::abs(a - place_m) < std::abs(b - place_m); };
        return std::min_element(places_m.begin(), places_m.end(), is_nearer) - places_m.begin();
    }

    std::vector<double> columns_m_, rows_m_;
    double radius_m_;
    std::vector<bool> is_seen_;  // column by column
};
