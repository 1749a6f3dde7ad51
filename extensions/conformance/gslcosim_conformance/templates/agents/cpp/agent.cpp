// NAME: flies half a metre up the wind, again and again. Now make it find the source.

#include <cmath>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>

int main() {
    double height_m = 0;
    for (std::string line; std::getline(std::cin, line);) {
        const auto message = nlohmann::json::parse(line);
        if (message.at("message") == "Ending") break;
        if (message.at("message") == "Briefing") height_m = message.at("search_height_m");
        if (message.value("awaiting_command", false)) {
            const double x_m = message.at("position_world_m").at(0), y_m = message.at("position_world_m").at(1);
            double upwind_rad = 0;
            for (const auto& reading : message.at("readings"))
                if (reading.at("sensor") == "wind") upwind_rad = reading.at("values").at(1);
            const nlohmann::json command = {
                {"tick", message.at("tick")},
                {"kind", "waypoint"},
                {"position_world_m", {x_m + 0.5 * std::cos(upwind_rad), y_m + 0.5 * std::sin(upwind_rad), height_m}},
            };
            std::cout << command << std::endl;
        }
    }
}
