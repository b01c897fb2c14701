#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <tribotwin_commit.hpp>  // written by commit.cmake

#include <tribotwin/twin/io/command_line/version.hpp>
#include <tribotwin/twin/io/json.hpp>

namespace tribotwin::twin::program {
namespace {

#ifdef __clang__
constexpr char compiler[] = "Clang " __clang_version__;
#else
constexpr char compiler[] = "GCC " __VERSION__;
#endif

constexpr std::pair<const char*, const char*> libraries[] = {TRIBOTWIN_LIBRARY_VERSIONS};

}  // namespace

std::string version_number() { return TRIBOTWIN_VERSION; }
std::string version_date() { return TRIBOTWIN_COMMIT_DATE; }

std::string version_text(const std::string& program, const std::string& engine) {
  return fmt::format("{} {}, MuJoCo {}\ncommit {}, {}, {}", program, TRIBOTWIN_VERSION, engine, TRIBOTWIN_COMMIT,
                     compiler, TRIBOTWIN_BUILD_TYPE);
}

std::string version_json(const std::string& program, const std::string& engine) {
  nlohmann::ordered_json json{{"program", program},
                              {"version", TRIBOTWIN_VERSION},
                              {"engine", {{"name", "MuJoCo"}, {"version", engine}}},
                              {"commit", TRIBOTWIN_COMMIT},
                              {"compiler", compiler},
                              {"build_type", TRIBOTWIN_BUILD_TYPE}};
  for (const auto& [name, version] : libraries) json["libraries"][name] = version;
  return dump_json(json, 2);
}

}  // namespace tribotwin::twin::program
