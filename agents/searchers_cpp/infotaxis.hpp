// Infotaxis: goes where the entropy of its belief is expected to be least. The rules are those of ../infotaxis.
#pragma once

#include <cstring>

#include "common.hpp"
#include "encounters.hpp"
#include "sensing.hpp"

inline double square_m2(const Vec2& a, const Vec2& b) {
    return (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
}

inline void normalise(std::vector<double>& weights) {
    double total = 0.0;
    for (double weight : weights) total += weight;
    for (double& weight : weights) weight /= total;
}

// The success radius where the vehicle's arrival at one source ends the search [m]; 0 elsewhere.
inline double arrival_radius_m(const json& briefing) {
    const json task = briefing.value("task", json{});
    return task.is_object() && task.at("goal") == "source" ? task.at("success_radius_m").get<double>() : 0.0;
}

inline std::string base64(const std::vector<std::uint8_t>& bytes) {
    const char* letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string text;
    for (std::size_t at = 0; at < bytes.size(); at += 3) {
        std::uint32_t bits = 0;
        for (std::size_t i = at; i < at + 3; ++i) bits = bits << 8 | (i < bytes.size() ? bytes[i] : 0);
        for (std::size_t i = 0; i < 4; ++i) text += at + i <= bytes.size() ? letters[bits >> (18 - 6 * i) & 63] : '=';
    }
    return text;
}

using Finding = std::pair<bool, Vec2>;  // gas or clean air, and where

// Turns readings into findings, one for each span: gas, or clean air; see gas_evidence.GasEvidence.
class Evidence {
public:
    Evidence(const json& briefing, double every_s, double threshold_ppm)
        : nose_{briefing},
          every_s_{every_s},
          lag_s_{nose_.unit() == "ohm" ? 1.0 : 0.0},
          threshold_{nose_.unit() == "ppm" ? threshold_ppm : 0.5} {}

    std::optional<Finding> add(const json& observation) {
        const double time_s = observation.at("time_s");
        track_.emplace_back(time_s, place_of(observation));
        while (track_.size() > 1 && track_[1].first <= time_s - lag_s_ + rounding_s) track_.pop_front();
        read(observation, time_s);
        if (!ends_s_) ends_s_ = time_s + every_s_;
        if (time_s < *ends_s_ - rounding_s) return std::nullopt;
        ends_s_ = time_s + every_s_;
        const bool is_finding = was_hit_ || !is_unclear_;
        const Finding finding{was_hit_, track_.front().second};
        was_hit_ = is_unclear_ = false;
        return is_finding ? std::optional<Finding>{finding} : std::nullopt;
    }

private:
    static constexpr double rounding_s = 1e-6;

    void read(const json& observation, double time_s) {
        const double value = nose_.value(observation);
        const bool is_ready = nose_.is_ready(observation), is_in_ohm = nose_.unit() == "ohm";
        was_hit_ |= is_ready && (is_in_ohm ? mox_.add(time_s, value) : value > threshold_);
        is_unclear_ |= !is_ready || (is_in_ohm && mox_.is_recovering());
    }

    Nose nose_;
    MoxEvidence mox_;
    double every_s_, lag_s_, threshold_;
    std::deque<std::pair<double, Vec2>> track_;
    std::optional<double> ends_s_;
    bool was_hit_ = false, is_unclear_ = false;
};

// The mean winds of the last seconds; see wind_field.WindRecord.
class WindRecord {
public:
    WindRecord(const json& briefing, double memory_s)
        : vane_{briefing}, n_steps_{static_cast<std::size_t>(std::max(1.0, std::nearbyint(memory_s)))} {}

    void add(const json& observation) {
        const auto wind = vane_.wind(observation);
        if (!wind) return;
        const double time_s = observation.at("time_s");
        const Vec3 own_m_s = observation.at("velocity_world_m_s");
        if (!ends_s_) ends_s_ = time_s + 1.0;
        sum_ = {sum_[0] + (wind->x_m_s + own_m_s[0]), sum_[1] + (wind->y_m_s + own_m_s[1])};
        n_samples_ += 1.0;
        const double n_over = std::floor((time_s - *ends_s_) + 1e-6) + 1.0;
        if (n_over <= 0.0) return;
        for (double i = 0.0; i < n_over && i < static_cast<double>(n_steps_); ++i)
            steps_.push_back({sum_[0] / n_samples_, sum_[1] / n_samples_});
        while (steps_.size() > n_steps_) steps_.pop_front();
        *ends_s_ += n_over;
        sum_ = {0.0, 0.0}, n_samples_ = 0.0;
    }

    Vec2 mean_m_s() const { return mean(std::vector<Vec2>(steps_.begin(), steps_.end())); }

    // How far the direction spreads.
    double spread_rad() const {
        std::vector<Vec2> units;
        for (const Vec2& wind : steps_) {
            const double speed_m_s = std::hypot(wind[0], wind[1]);
            if (speed_m_s > 0.0) units.push_back({wind[0] / speed_m_s, wind[1] / speed_m_s});
        }
        if (units.empty()) return 0.0;
        const Vec2 unit = mean(units);
        return std::min(1.5, std::sqrt(-2.0 * std::log(std::clamp(std::hypot(unit[0], unit[1]), 1e-6, 1.0))));
    }

private:
    static Vec2 mean(const std::vector<Vec2>& winds) {
        Vec2 sum{0.0, 0.0};
        for (const Vec2& wind : winds) sum = {sum[0] + wind[0], sum[1] + wind[1]};
        const double n = std::max(1.0, static_cast<double>(winds.size()));
        return {sum[0] / n, sum[1] / n};
    }

    Vane vane_;
    std::size_t n_steps_;
    std::deque<Vec2> steps_;
    Vec2 sum_{0.0, 0.0};
    double n_samples_ = 0.0;
    std::optional<double> ends_s_;
};

// Notices that outcomes surprise more than the model allows; see information.SurpriseMonitor.
class SurpriseMonitor {
public:
    explicit SurpriseMonitor(std::size_t n_stops) : n_stops_{n_stops} {}

    bool finds_wrong(Vec2 rho, std::size_t outcome) {
        rho = {std::max(rho[0], 1e-12), std::max(rho[1], 1e-12)};
        const Vec2 log_rho{std::log(rho[0] / (rho[0] + rho[1])), std::log(rho[1] / (rho[0] + rho[1]))};
        const Vec2 chance{std::exp(log_rho[0]), std::exp(log_rho[1])};
        const double expected = -(chance[0] * log_rho[0] + chance[1] * log_rho[1]);
        const double square = chance[0] * log_rho[0] * log_rho[0] + chance[1] * log_rho[1] * log_rho[1];
        excesses_.push_back(-log_rho[outcome] - expected);
        variances_.push_back(std::max(0.0, square - expected * expected));
        if (excesses_.size() > n_stops_) excesses_.erase(excesses_.begin()), variances_.erase(variances_.begin());
        if (excesses_.size() < n_stops_ || exact_sum(excesses_) <= 3.0 * std::sqrt(exact_sum(variances_))) return false;
        excesses_.clear(), variances_.clear();
        return true;
    }

private:
    std::size_t n_stops_;
    std::vector<double> excesses_, variances_;
};

class Infotaxis : public Method {
public:
    explicit Infotaxis(const json& briefing)
        : settings_{briefing,
                    {"cell_m", "step_m", "n_headings", "may_stay", "hold_s", "stop_s", "wall_margin_m",
                     "threshold_ppm", "floor", "power", "hits_at_1m", "diffusivity_m2_s", "lifetime_s", "detector_m",
                     "wind_memory_s", "correlation_s", "arrival", "declares", "radius_m", "mass", "entropy_bits",
                     "monitor_stops"}},
          cell_m_{settings_.number("cell_m", 0.5)},
          step_m_{settings_.number("step_m", 1.5)},
          stop_s_{settings_.number("stop_s", 2.0)},
          floor_{settings_.number("floor", 0.05)},
          power_{settings_.number("power", 0.4)},
          room_{briefing, settings_.number("wall_margin_m", 0.5)},
          evidence_{briefing, stop_s_, settings_.number("threshold_ppm", 0.1)},
          winds_{briefing, settings_.number("wind_memory_s", 20.0)},
          monitor_{settings_.whole("monitor_stops", 20)} {
        settings_.require_no_declarations();
        for (const char* grant : {"known_map", "plume"})
            if (briefing.contains(grant) && !briefing[grant].is_null())
                throw std::runtime_error(std::string{grant} + ": infotaxis in C++ flies without it only");
        if (settings_.choice("arrival", {"by_mission", "nothing"}) == "by_mission")
            arrival_m_ = arrival_radius_m(briefing);
        const Vec3 low_m = briefing.at("bounds").at("min_m"), high_m = briefing.at("bounds").at("max_m");
        for (std::size_t axis = 0; axis < 2; ++axis)
            shape_[axis] = std::max(1, static_cast<int>(std::ceil((high_m[axis] - low_m[axis]) / cell_m_ - 1e-9)));
        for (double i = 0.5; i < shape_[0]; ++i)
            for (double j = 0.5; j < shape_[1]; ++j)
                cells_m_.push_back({low_m[0] + i * cell_m_, low_m[1] + j * cell_m_});
        p_.assign(cells_m_.size(), 1.0 / static_cast<double>(cells_m_.size()));
        is_passed_.assign(cells_m_.size(), false);
        corner_m_ = {low_m[0], low_m[1], briefing.at("search_height_m").get<double>()};
        const double room_length_m = std::max(high_m[0] - low_m[0], high_m[1] - low_m[1]);
        dispersal_ = {settings_.number("hits_at_1m", 1.0), settings_.number("diffusivity_m2_s", 0.1),
                      settings_.number("lifetime_s", 300.0), room_length_m, settings_.number("detector_m", 0.1),
                      settings_.number("correlation_s", 5.0), stop_s_};
    }

    void observe(const json& observation) override {
        winds_.add(observation);
        if (const auto finding = evidence_.add(observation)) findings_.push_back(*finding);
        mark_passed(place_of(observation));
    }

    json decide(const json& observation) override {
        const Encounters model = dispersal_.model(winds_.mean_m_s(), winds_.spread_rad());
        for (const auto& [is_hit, place_m] : findings_) learn(is_hit, place_m, model);
        findings_.clear();
        if (has_notice(observation) && aimed_m_) refused_m_.push_back(*aimed_m_);
        const json belief = belief_message(observation.at("time_s"));
        aimed_m_ = next_place_m(place_of(observation), model);
        json command = waypoint(observation, *aimed_m_, corner_m_[2], settings_.number_if_given("hold_s"));
        if (!belief.is_null()) command["belief"] = belief;
        return command;
    }

private:
    // Takes a finding into the belief, and trusts the belief less where findings surprise too much.
    void learn(bool is_hit, const Vec2& place_m, const Encounters& model) {
        const double novelty = novelty_of(place_m), power = power_ * novelty;
        Vec2 predictive{0.0, 0.0};
        std::vector<double> log_p;
        for (std::size_t j = 0; j < p_.size(); ++j) {
            const Outcomes told = outcomes_of(model.log_mean_hits(place_m, cells_m_[j]), floor_, 1.0);
            for (std::size_t h = 0; h < 2; ++h) predictive[h] += told.likelihood[h] * p_[j];
            log_p.push_back(std::log(p_[j]) + power * told.log_weight[is_hit]);
        }
        const double highest = *std::max_element(log_p.begin(), log_p.end());
        if (std::isfinite(highest)) {
            for (std::size_t j = 0; j < p_.size(); ++j) p_[j] = std::exp(log_p[j] - highest);
            normalise(p_);
        }
        smelled_m_.push_back(place_m);
        if (novelty < 1.0 || !monitor_.finds_wrong(predictive, is_hit)) return;
        for (double& p : p_) p = std::sqrt(p);
        normalise(p_);
    }

    // 1 where nothing was found out near a place yet, and 1 / (1 + n) after n findings of the last 50.
    double novelty_of(const Vec2& place_m) const {
        double n = 0.0;
        for (std::size_t i = smelled_m_.size() < 50 ? 0 : smelled_m_.size() - 50; i < smelled_m_.size(); ++i)
            n += square_m2(place_m, smelled_m_[i]) < (0.5 * step_m_) * (0.5 * step_m_);
        return 1.0 / (1.0 + n);
    }

    bool is_reached(const Vec2& cell_m, const Vec2& place_m) const {
        return arrival_m_ > 0.0 && square_m2(cell_m, place_m) < arrival_m_ * arrival_m_;
    }

    // The run would have ended near the source: what was passed is hardly there.
    void mark_passed(const Vec2& here_m) {
        if (arrival_m_ <= 0.0 || (marked_m_ && std::sqrt(square_m2(here_m, *marked_m_)) <= 0.5 * cell_m_)) return;
        marked_m_ = here_m;
        bool is_news = false;
        for (std::size_t j = 0; j < p_.size(); ++j) {
            if (is_passed_[j] || !is_reached(cells_m_[j], here_m)) continue;
            is_passed_[j] = is_news = true;
            p_[j] *= 0.1;
        }
        if (is_news) normalise(p_);
    }

    // Where the next stop may be.
    std::vector<Vec2> neighbours(const Vec2& here_m) const {
        std::vector<Vec2> ends_m;
        if (settings_.flag("may_stay", false)) ends_m.push_back(room_.nearest(here_m));
        const std::size_t n = settings_.whole("n_headings", 8);
        for (std::size_t k = 0; k < n; ++k) {
            const double heading_rad = full_turn_rad * static_cast<double>(k) / static_cast<double>(n);
            const auto end_m = room_.leg_end(here_m, heading_rad, step_m_);
            const auto is_refused = [&](const Vec2& refused_m) { return square_m2(*end_m, refused_m) < 0.0625; };
            if (end_m && std::none_of(refused_m_.begin(), refused_m_.end(), is_refused)) ends_m.push_back(*end_m);
        }
        if (ends_m.empty()) ends_m.push_back(room_.nearest(here_m));
        return ends_m;
    }

    // The entropy that is expected after a stop; a sure find comes first.
    double cost(const Vec2& place_m, const Encounters& model) const {
        const double power = power_ * novelty_of(place_m);
        Vec2 chance{}, z{}, z_log_p{}, z_log_w{};
        for (std::size_t j = 0; j < p_.size(); ++j) {
            if (is_reached(cells_m_[j], place_m)) continue;  // found if it is there
            const Outcomes told = outcomes_of(model.log_mean_hits(place_m, cells_m_[j]), floor_, power);
            const double log_p = p_[j] > 0.0 ? std::log(p_[j]) : 0.0;
            for (std::size_t h = 0; h < 2; ++h) {
                const double w = p_[j] * told.weight[h];
                chance[h] += p_[j] * told.likelihood[h];
                z[h] += w;
                z_log_p[h] += w * log_p;
                z_log_w[h] += w * told.log_weight[h];
            }
        }
        double cost = 1.0 - (chance[0] + chance[1]) > 1.0 - same_cost ? -1.0 : 0.0;
        for (std::size_t h = 0; h < 2; ++h) {
            const double nats = z[h] > 0.0 ? std::log(z[h]) - (z_log_p[h] + z_log_w[h]) / z[h] : 0.0;
            cost += chance[h] * std::max(0.0, nats * (1.0 / std::log(2.0)));
        }
        return cost;
    }

    // The place of least cost, the first of equal ones.
    Vec2 next_place_m(const Vec2& here_m, const Encounters& model) const {
        const std::vector<Vec2> places_m = neighbours(here_m);
        std::vector<double> costs;
        for (const Vec2& place_m : places_m) costs.push_back(cost(place_m, model));
        const double limit = *std::min_element(costs.begin(), costs.end()) + same_cost;
        return places_m[std::find_if(costs.begin(), costs.end(), [&](double c) { return c <= limit; }) - costs.begin()];
    }

    // The belief as a command carries it, at most once a second.
    json belief_message(double time_s) {
        if (time_s < belief_s_ + 1.0) return nullptr;
        belief_s_ = time_s;
        std::vector<double> p = p_;
        normalise(p);
        const std::vector<float> single(p.begin(), p.end());
        std::vector<std::uint8_t> bytes(4 * single.size());
        std::memcpy(bytes.data(), single.data(), bytes.size());
        const json probability{{"dtype", "float32"}, {"shape", shape_}, {"data", base64(bytes)}};
        return {{"origin_m", corner_m_}, {"cell_m", cell_m_}, {"probability", probability}};
    }

    static constexpr double same_cost = 1e-10;
    Parameters settings_;
    double cell_m_, step_m_, stop_s_, floor_, power_, arrival_m_ = 0.0;
    Room room_;
    Evidence evidence_;
    WindRecord winds_;
    SurpriseMonitor monitor_;
    Dispersal dispersal_{};
    std::array<int, 2> shape_{};
    Vec3 corner_m_{};
    std::vector<Vec2> cells_m_, smelled_m_, refused_m_;
    std::vector<double> p_;
    std::vector<bool> is_passed_;
    std::vector<Finding> findings_;
    std::optional<Vec2> marked_m_, aimed_m_;
    double belief_s_ = -std::numeric_limits<double>::infinity();
};
