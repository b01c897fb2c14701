#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/render/commands/picture.hpp>

namespace tribotwin::render::program {

using twin::InputError;

void PictureOptions::add_to(CLI::App& command, const char* target_help, const char* default_size,
                            const char* default_output) {
  size = default_size;
  output.file = default_output;
  command.add_option("TARGET", target, target_help)->required();
  output.add_to(command, "File to write")->capture_default_str();
  output.add_json_to(command);
  command.add_option("--size", size, fmt::format("WIDTHxHEIGHT in pixels, {} to {} a side", side_min, side_max))
      ->capture_default_str();
  command
      .add_option("--text-scale", text_scale,
                  "Size of the text; above 1 for a picture that is shown smaller than it is")
      ->check(CLI::Range(0.2, 5.0))
      ->capture_default_str();
  command.add_option("--colour-by", colour_by, "What the joint housings show")
      ->check(CLI::IsMember({"temperature", "friction", "nothing"}));
  command.add_option("--camera", camera, "A camera of the model (default: overview, where there is one)");
  command.add_option("--azimuth", azimuth, "Free camera: angle about the vertical [deg]");
  command.add_option("--elevation", elevation, "Free camera: angle above the horizontal [deg]; negative looks down");
  command.add_option("--distance", distance, "Free camera: distance from the point it looks at [m]");
  command.add_option("--look-at", look_at, "Free camera: X Y Z [m]")->expected(3);
  command.add_flag("--quiet", quiet, "No progress");
}

void PictureOptions::check_output(const char* what, const char* extension) const {
  if (!output.file.ends_with(extension))
    throw InputError(fmt::format("-o {}: the name of {} must end in {}", output.file, what, extension));
  auto read = run_files(target);
  read.emplace_back(target);
  twin::or_wrong_input(output.check(read));
}

Size PictureOptions::pixels() const {
  if (const auto sides = width_and_height(size)) return {sides->first, sides->second};
  throw InputError(fmt::format("--size {}: must be WIDTHxHEIGHT in pixels, for example 1280x960", size));
}

View PictureOptions::view() const {
  View v{.camera = camera, .azimuth_deg = azimuth, .elevation_deg = elevation, .distance_m = distance};
  for (const auto& [option, value] :
       {std::pair{"--azimuth", azimuth}, {"--elevation", elevation}, {"--distance", distance}})
    if (value && !std::isfinite(*value)) throw InputError(fmt::format("{}: must be a finite number", option));
  if (distance && *distance <= 0) throw InputError(fmt::format("--distance {}: must be above 0 m", *distance));
  if (!look_at.empty()) v.look_at_m = {look_at[0], look_at[1], look_at[2]};
  return v;
}

ColourBy PictureOptions::colours(ColourBy otherwise) const {
  return colour_by.empty()            ? otherwise
         : colour_by == "temperature" ? ColourBy::temperature
         : colour_by == "friction"    ? ColourBy::friction
                                      : ColourBy::nothing;
}

std::pair<std::string, double> assignment(const char* option, const std::string& given) {
  const auto equals = given.rfind('=');
  if (equals != std::string::npos && equals > 0)
    if (const auto value = to_number(std::string_view(given).substr(equals + 1)); value && std::isfinite(*value))
      return {given.substr(0, equals), *value};
  throw InputError(fmt::format("{} {}: must be JOINT=NUMBER, for example joint2=0.5", option, given));
}

std::unique_ptr<RunData> run_with_model(const std::string& directory) {
  auto run = twin::or_wrong_input(load_run(directory));
  if (!run->damage.empty() || !run->model() || run->record.time_s.empty())
    throw InputError(run->missing.empty() ? directory + ": has no samples" : run->missing.front());
  for (const auto& what : run->missing) twin::note("{}", what);
  return run;
}

PoseOptions run_options(const PictureOptions& options, const RunData& run) {
  PoseOptions pose;
  pose.view = options.view();
  pose.view.whole = outline(*run.model(), run.record);
  pose.text_scale = options.text_scale;
  pose.colour_by = options.colours(ColourBy::temperature);
  pose.scale = scale_of(*run.model(), run.record, pose.colour_by);
  return pose;
}

}  // namespace tribotwin::render::program
