// Search methods in C++: `searchers METHOD` speaks JSON lines on standard input and output.
// Each method answers the same observations with the same commands as its Python namesake in ../.

#include <cstdlib>
#include <exception>
#include <functional>
#include <iostream>
#include <map>
#include <memory>

#include "common.hpp"
#include "e_coli.hpp"
#include "infotaxis.hpp"
#include "surge_cast.hpp"

namespace {

using Maker = std::function<std::unique_ptr<Method>(const json&)>;

const std::map<std::string, Maker> makers{
    {"e_coli", [](const json& briefing) { return std::make_unique<EColi>(briefing); }},
    {"infotaxis", [](const json& briefing) { return std::make_unique<Infotaxis>(briefing); }},
    {"surge_cast", [](const json& briefing) { return std::make_unique<SurgeCast>(briefing); }},
};

void check_contract(const json& briefing) {
    const std::string version = briefing.at("contract_version");
    if (version.rfind("1.", 0) != 0) throw std::runtime_error("expected contract version 1, was " + version);
}

void fly(const Maker& make) {
    std::unique_ptr<Method> method;
    for (std::string line; std::getline(std::cin, line);) {
        const json message = json::parse(line);
        const std::string kind = message.at("message");
        if (kind == "Ending") return;
        if (kind == "Briefing") {
            check_contract(message);
            method = make(message);
            continue;
        }
        if (!method) throw std::runtime_error("expected a briefing before the first observation");
        method->observe(message);
        if (message.value("awaiting_command", false))
            std::cout << method->decide(message) << std::endl;  // endl also flushes: the run waits for it
    }
}

}  // namespace

int main(int n_arguments, char** arguments) {
    std::ios::sync_with_stdio(false);
    try {
        const auto found = n_arguments == 2 ? makers.find(arguments[1]) : makers.end();
        if (found == makers.end()) {
            std::string names;
            for (const auto& maker : makers) names += " " + maker.first;
            throw std::runtime_error("expected the name of one method:" + names);
        }
        fly(found->second);
    } catch (const std::exception& error) {
        std::cerr << "searchers_cpp: " << error.what() << '\n';
        return EXIT_FAILURE;
    }
}
