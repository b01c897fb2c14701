#include <fmt/format.h>

#include <tribotwin/hil/session/files.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::hil {
namespace {

namespace fs = std::filesystem;

/// Every value of a resolved scenario that is the absolute path of a file.
void add_paths(const YAML::Node& node, const std::string& of, std::vector<NamedFile>& files) {
  std::error_code none;
  if (node.IsScalar() && node.Scalar().starts_with('/') && fs::is_regular_file(node.Scalar(), none))
    files.push_back({fmt::format("{} of {}", node.Scalar(), of), node.Scalar()});
  if (node.IsSequence())
    for (const auto& entry : node) add_paths(entry, of, files);
  if (node.IsMap())
    for (const auto& entry : node) add_paths(entry.second, of, files);
}

}  // namespace

std::vector<NamedFile> files_of(const twin::Scenario& scenario) {
  std::vector<NamedFile> files{{fmt::format("SCENARIO {}", scenario.file.string()), scenario.file}};
  add_paths(YAML::Load(scenario.resolved_yaml), scenario.file.string(), files);
  return files;
}

std::vector<NamedFile> files_in(const fs::path& directory) {
  if (directory.empty()) return {};
  std::vector<NamedFile> files{{fmt::format("-o {}", directory.string()), directory}};
  for (const char* file : {"telemetry.h5", "scenario.yaml", "summary.json"})
    files.push_back({fmt::format("{} of -o {}", file, directory.string()), directory / file});
  return files;
}

Result<void> refuse_shared(const std::vector<NamedFile>& inputs, const std::vector<NamedFile>& outputs) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const NamedFile& output = outputs[i];
    if (output.path.empty()) continue;
    for (const NamedFile& input : inputs)
      if (!input.path.empty() && twin::is_same_file(input.path, output.path))
        return tl::unexpected(
            fmt::format("{} would overwrite what {} reads: they are one file; give the output another name",
                        output.name, input.name));
    for (std::size_t k = 0; k < i; ++k)
      if (!outputs[k].path.empty() && twin::is_same_file(outputs[k].path, output.path))
        return tl::unexpected(fmt::format("{} and {} are one file; give them two names", outputs[k].name, output.name));
  }
  return {};
}

Result<void> refuse_recorded(const std::vector<NamedFile>& outputs) {
  std::error_code none;
  for (const NamedFile& output : outputs)
    if (!output.path.empty() && fs::is_regular_file(output.path, none) && fs::file_size(output.path, none) > 0)
      return tl::unexpected(fmt::format("{}: holds a session already; give another name, or --force to replace it",
                                        output.path.string()));
  return {};
}

}  // namespace tribotwin::hil
