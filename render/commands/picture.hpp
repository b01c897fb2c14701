#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <tribotwin/render/commands/program.hpp>
#include <tribotwin/render/offscreen/renderer.hpp>
#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/render/report/record/run_data.hpp>

/// Options and input that the commands for pictures share.
namespace tribotwin::render::program {

struct PictureOptions {
  std::string target, size, camera, colour_by;
  twin::Destination output;
  std::optional<double> azimuth, elevation, distance;
  std::vector<double> look_at;
  double text_scale = 1;
  bool quiet = false;

  void add_to(CLI::App& command, const char* target_help, const char* default_size, const char* default_output);

  /// Before any work: the output must have this file name extension and must not be an input. `what` is drawn.
  void check_output(const char* what, const char* extension) const;
  Size pixels() const;
  View view() const;
  ColourBy colours(ColourBy otherwise) const;
};

/// The value and the joint of an option JOINT=NUMBER.
std::pair<std::string, double> assignment(const char* option, const std::string& given);

/// The model and the samples of a run; says on stderr what else is missing.
std::unique_ptr<RunData> run_with_model(const std::string& directory);

/// The options of all pictures of one run: they have one colour scale.
PoseOptions run_options(const PictureOptions& options, const RunData& run);

}  // namespace tribotwin::render::program
