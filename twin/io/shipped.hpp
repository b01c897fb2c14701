#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Models, scenarios and campaigns that ship with the programs. They lie in PREFIX/share/tribotwin of the program that
/// runs, or in the source tree that it was built from.
namespace tribotwin::twin {

/// The folder with mjcf/ and twin/scenarios/; empty where neither is there.
std::filesystem::path shipped_folder();

/// Models, and scenarios and campaigns, in alphabetical order; none without shipped_folder().
std::vector<std::filesystem::path> shipped_models();
std::vector<std::filesystem::path> shipped_scenarios();

/// What a shipped file is for: a motion (`run`), measurements (`lab`), recordings to fit twins to (`calibrate`), many
/// runs (`sweep`).
enum class Purpose { scenario, campaign, fit, plan };
std::vector<std::filesystem::path> shipped_scenarios(Purpose purpose);

/// The file that a user names: as given, or, where no such file exists, the shipped one of that name or path:
/// "irb6620_warmup", "twin/scenarios/irb6620_warmup.yaml", "mjcf/irb6620.xml", "irb6620.xml". As given where nothing
/// ships under it, so that the reader says what is missing; InputError where something ships under nearly that name.
/// `ending` is added to a name without one.
std::filesystem::path given_or_shipped(const std::string& given, std::string_view ending);

/// A file or a run's folder that the file `by` names: as it is called from the working directory, or beside `by`.
std::optional<std::filesystem::path> named_file(const std::string& name, const std::filesystem::path& by);

}  // namespace tribotwin::twin
