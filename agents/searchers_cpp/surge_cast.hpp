// Surge-cast: upwind while there is gas; across the wind when it is lost. The rules are those of ../surge_cast.
#pragma once

#include "common.hpp"
#include "piloting.hpp"
#include "sensing.hpp"

class SurgeCast : public Method {
public:
    explicit SurgeCast(const json& briefing)
        : settings_{briefing,
                    {"step_m", "lost_by", "lost_m", "memory_s", "least_memory_s", "most_memory_s", "cast_m",
                     "growth", "n_casts", "n_returns", "explore", "aborts_legs", "margin_m", "hold_s",
                     "explore_hold_s", "explore_step_m", "threshold_ppm", "threshold_m_s", "leash_legs", "leash_m",
                     "leash_away_legs", "declares"}},
          step_m_{settings_.number("step_m", 1.0)},
          is_lost_by_distance_{settings_.choice("lost_by", {"distance", "last_blank"}) == "distance"},
          lost_m_{settings_.number("lost_m", 2.0)},
          cast_m_{settings_.number("cast_m", 0.75)},
          growth_{settings_.choice("growth", {"growing", "fixed", "doubling"})},
          n_casts_{settings_.whole("n_casts", 4)},
          n_returns_{settings_.whole("n_returns", 1)},
          explores_unseen_{settings_.choice("explore", {"unseen", "random"}) == "unseen"},
          hold_s_{settings_.number_if_given("hold_s")},
          explore_hold_s_{settings_.number("explore_hold_s", 0.0)},
          least_memory_s_{settings_.number("least_memory_s", 1.0)},
          most_memory_s_{settings_.number("most_memory_s", 20.0)},
          memory_s_{within_memory_s(settings_.number("memory_s", 5.0))},
          pilot_{briefing, settings_.number("margin_m", 0.5)},
          watch_{briefing, settings_.number("threshold_ppm", 0.1), settings_.number("threshold_m_s", 0.1)},
          unseen_{pilot_.room, settings_.number("explore_step_m", 1.8)},
          leash_{settings_.whole("leash_legs", 20), settings_.number("leash_m", 2.0)} {
        settings_.require_no_declarations();
        const bool has_map = briefing.contains("known_map") && !briefing["known_map"].is_null();
        if (briefing.at("mode") != "on_request" || has_map)
            throw std::runtime_error("surge_cast in C++ flies on request and without a map only");
    }

    void observe(const json& observation) override {
        if (watch_.add(observation)) note_hit(observation.at("time_s"));
        unseen_.note(place_of(observation), true);
    }

    json decide(const json& observation) override {
        const Contact contact = watch_.contact();
        if (leash_.pulls(place_of(observation))) n_away_ = settings_.whole("leash_away_legs", 6);
        if (!contact.upwind_rad || n_away_ > 0) {
            is_surging_ = false;
            cast_.reset();
            return explore(observation, contact);
        }
        if (contact.has_gas) {
            is_surging_ = true;
            cast_.reset();
            upwind_rad_ = *contact.upwind_rad;
        }
        if (is_surging_ && !is_lost(observation, contact)) return surge(observation, contact);
        if (is_surging_) {
            is_surging_ = false;
            n_returns_left_ = n_returns_;
            cast_ = new_cast(place_of(observation), contact);
        }
        return cast_or_explore(observation, contact);
    }

private:
    // A flight across the wind, one way and then farther the other, from where a plume was lost.
    struct Cast {
        Vec2 anchor_m, across;
        std::size_t n_done = 0;
    };

    double within_memory_s(double s) const { return std::min(std::max(s, least_memory_s_), most_memory_s_); }

    void note_hit(double time_s) {
        if (last_hit_s_ && time_s - *last_hit_s_ > 0.0) memory_s_ = within_memory_s(time_s - *last_hit_s_);
        last_hit_s_ = time_s;
    }

    bool is_lost(const json& observation, const Contact& contact) const {
        if (contact.has_gas) return false;
        if (is_lost_by_distance_) return way_left_m(observation, contact) <= 0.1;
        return !last_hit_s_ || observation.at("time_s").get<double>() - *last_hit_s_ > memory_s_;
    }

    // How far to fly on without gas before the plume counts as lost.
    double way_left_m(const json& observation, const Contact& contact) const {
        if (contact.has_gas || !contact.last_m)
            return (contact.has_gas ? 1.0 : -1.0) * std::numeric_limits<double>::infinity();
        return lost_m_ - distance_m(*contact.last_m, observation.at("position_world_m").get<Vec3>());
    }

    // A leg upwind, in line with the gas of the last leg.
    json surge(const json& observation, const Contact& contact) {
        const Vec2 here_m = place_of(observation);
        const double step_m = is_lost_by_distance_ ? std::min(step_m_, way_left_m(observation, contact)) : step_m_;
        const double along_x = std::cos(upwind_rad_), along_y = std::sin(upwind_rad_);
        const Vec3 gas_m = contact.gas_m.value_or(Vec3{here_m[0], here_m[1], 0.0});
        const double across_m = (gas_m[1] - here_m[1]) * along_x - (gas_m[0] - here_m[0]) * along_y;
        return fly_to(observation,
                      {here_m[0] + step_m * along_x - across_m * along_y,
                       here_m[1] + step_m * along_y + across_m * along_x},
                      hold_s_);
    }

    json cast_or_explore(const json& observation, const Contact& contact) {
        while (cast_) {
            while (const auto place_m = next_turn_m(*cast_))
                if (pilot_.is_worth_it(observation, *place_m)) return fly_to(observation, *place_m, explore_hold_s_);
            cast_.reset();
            if (n_returns_left_ == 0 || !contact.last_m) break;
            --n_returns_left_;
            cast_ = new_cast({(*contact.last_m)[0], (*contact.last_m)[1]}, contact);
        }
        return explore(observation, contact);
    }

    // A cast that begins on the side on which gas was met last, else on a random one.
    Cast new_cast(const Vec2& here_m, const Contact& contact) {
        const double dx_m = contact.last_m ? (*contact.last_m)[0] - here_m[0] : 0.0;
        const double dy_m = contact.last_m ? (*contact.last_m)[1] - here_m[1] : 0.0;
        const double cross_m = std::cos(upwind_rad_) * dy_m - std::sin(upwind_rad_) * dx_m;
        const bool is_left = std::abs(cross_m) <= 0.001 ? pilot_.draws.fraction() < 0.5 : cross_m > 0.0;
        const double across_rad = upwind_rad_ + (is_left ? right_angle_rad : -right_angle_rad);
        return {here_m, {std::cos(across_rad), std::sin(across_rad)}};
    }

    double cast_length_m(std::size_t n) const {
        if (growth_ == "doubling") return cast_m_ * std::ldexp(1.0, static_cast<int>(n));
        return cast_m_ * static_cast<double>(growth_ == "fixed" ? std::min<std::size_t>(n, 1) + 1 : n + 1);
    }

    // The end of the next leg of a cast, or nothing when it is over.
    std::optional<Vec2> next_turn_m(Cast& cast) const {
        if (cast.n_done >= n_casts_) return std::nullopt;
        std::vector<double> legs_m;
        for (std::size_t n = 0; n <= cast.n_done; ++n) legs_m.push_back((n % 2 == 0 ? 1.0 : -1.0) * cast_length_m(n));
        const double offset_m = exact_sum(legs_m);
        ++cast.n_done;
        return Vec2{cast.anchor_m[0] + offset_m * cast.across[0], cast.anchor_m[1] + offset_m * cast.across[1]};
    }

    // A leg without gas: to a place not seen yet, or at random nearby.
    json explore(const json& observation, const Contact& contact) {
        const Vec2 here_m = place_of(observation);
        if (!explores_unseen_ && n_away_ == 0) {
            const double wander_x_m = pilot_.draws.uniform(-0.5, 0.5), wander_y_m = pilot_.draws.uniform(-0.5, 0.5);
            return fly_to(observation, {here_m[0] + wander_x_m, here_m[1] + wander_y_m}, explore_hold_s_);
        }
        if (n_away_ > 0) --n_away_;
        if (goal_m_ && pilot_.was_refused(observation)) unseen_.note(*goal_m_, false);
        const Vec2 goal_m = unseen_.next_place_m(here_m, contact.upwind_rad);
        json command = fly_to(observation, goal_m, explore_hold_s_);
        goal_m_ = goal_m;
        return command;
    }

    json fly_to(const json& observation, const Vec2& place_m, std::optional<double> hold_s) {
        goal_m_.reset();
        return pilot_.leg(observation, place_m, hold_s);
    }

    Parameters settings_;
    double step_m_;
    bool is_lost_by_distance_;
    double lost_m_, cast_m_;
    std::string growth_;
    std::size_t n_casts_, n_returns_;
    bool explores_unseen_;
    std::optional<double> hold_s_;
    double explore_hold_s_, least_memory_s_, most_memory_s_, memory_s_;
    Pilot pilot_;
    PlumeContactDetector watch_;
    UnseenSquares unseen_;
    Leash leash_;
    std::optional<double> last_hit_s_;
    double upwind_rad_ = 0.0;  // that of the surge
    bool is_surging_ = false;
    std::optional<Cast> cast_;
    std::size_t n_returns_left_ = 0, n_away_ = 0;
    std::optional<Vec2> goal_m_;
};
