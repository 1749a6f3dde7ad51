// E. coli: on with more gas, otherwise anywhere. The rules and the arithmetic are those of ../e_coli/README.md.
#pragma once

#include "common.hpp"

class EColi : public Method {
public:
    explicit EColi(const json& briefing)
        : settings_{briefing, {"step_m", "eps", "wall_margin_m", "hold_s", "measure", "declares"}},
          step_m_{settings_.number("step_m", 1.0)},
          eps_{settings_.number("eps", 0.005)},
          hold_s_{settings_.number_if_given("hold_s")},
          nose_{briefing},
          room_{briefing, settings_.number("wall_margin_m", 0.5)},
          height_m_{briefing.at("search_height_m")},
          draws_{briefing.at("seed").get<std::uint64_t>()} {
        settings_.require("measure", "last");
        settings_.require_no_declarations();
    }

    json decide(const json& observation) override {
        const bool keeps = has_more(observation) && !has_notice(observation);
        return waypoint(observation, next_end_m(place_of(observation), keeps), height_m_, hold_s_);
    }

private:
    bool has_more(const json& observation) {
        if (!nose_.is_ready(observation)) return false;
        const double amount = nose_.amount(observation);
        const auto before = before_;
        before_ = amount;
        return before && (1.0 - eps_) * amount > std::max(*before, 0.0);
    }

    // A leg that may not be flown draws another heading, also where it was to keep its own.
    Vec2 next_end_m(const Vec2& start_m, bool keeps) {
        if (keeps && heading_rad_)
            if (auto end_m = room_.leg_end(start_m, *heading_rad_, step_m_)) return *end_m;
        for (int i = 0; i < n_tries; ++i) {
            heading_rad_ = draws_.angle_rad();
            if (auto end_m = room_.leg_end(start_m, *heading_rad_, step_m_)) return *end_m;
        }
        heading_rad_.reset();
        return room_.nearest(start_m);
    }

    Parameters settings_;
    double step_m_, eps_;
    std::optional<double> hold_s_;
    Nose nose_;
    Room room_;
    double height_m_;
    RandomStream draws_;
    std::optional<double> before_, heading_rad_;
};
