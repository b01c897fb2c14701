#include <boost/uuid/name_generator_sha1.hpp>
#include <boost/uuid/uuid_io.hpp>
#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/slide.hpp>
#include <tribotwin/twin/portable/c_law.hpp>
#include <tribotwin/twin/portable/c_source.hpp>
#include <tribotwin/twin/portable/fmu.hpp>
#include <tribotwin/twin/portable/fmu_texts.hpp>
#include <tribotwin/twin/portable/fmu_variables.hpp>

namespace tribotwin::twin {
namespace {

/// The rows of fmu_variables in the C.
std::string variable_rows(const std::vector<FmuVariable>& variables) {
  std::string rows;
  for (const FmuVariable& v : variables) {
    if (v.unit.empty()) continue;
    const char* kind = v.kind == FmuKind::input     ? "is_input"
                       : v.kind == FmuKind::tunable ? "is_tunable"
                       : v.kind == FmuKind::fixed   ? "is_fixed"
                                                    : "is_result";
    const bool bounded = std::isfinite(v.minimum);
    rows += fmt::format("  {{\"{}\", offsetof(fmu_state, {}), {}, {}, {}}},\n", v.name, v.member, kind,
                        bounded ? c_number(v.minimum) : "-HUGE_VAL", bounded ? c_number(v.maximum) : "HUGE_VAL");
  }
  return rows;
}

/// Lines of functions that set the inputs' start values.
std::string start_values(const std::vector<FmuVariable>& variables) {
  std::string lines;
  for (const FmuVariable& v : variables)
    if (v.kind == FmuKind::fixed) lines += fmt::format("  s->{} = {};\n", v.member, c_number(v.start));
  return lines;
}

/// Lines that give the joint its temperatures at the start.
std::string start_temperatures(const drive::Drive& d) {
  std::string lines;
  if (has_heat(d)) lines += "  @NAME@_set_temperature(&s->joint, s->start_degC);\n";
  if (d.winding.present()) lines += "  @NAME@_set_winding_temperature(&s->joint, s->winding_start_degC);\n";
  return lines;
}

std::string functions_of(const drive::Drive& d, const std::string& name, FmiVersion version) {
  const auto variables = fmu_variables(d);
  const bool heat = has_heat(d);
  const bool winding = d.winding.present();
  const bool two = version == FmiVersion::two;
  const std::string text = std::string(two ? fmi2_types : fmi3_types) + fmu_modes + fmu_joint_head + fmu_calls +
                           fmu_joint + fmi_functions + (two ? fmi2_functions : fmi3_functions);
  return filled(text, {{"@WHAT@", "The joint @NAME@"},
                       {"@NEEDS@", "it needs @NAME@.c beside it, which holds the joint, and libm"},
                       {"@INCLUDE@", "#define @UPPER@_DECLARATIONS\n#include \"@NAME@.c\"\n"},
                       {"@VERSION@", std::to_string(static_cast<int>(version))},
                       {"@STATE@", two ? "FMUstate" : "FMUState"},
                       {"@DESERIALIZE@", two ? "DeSerializeFMUstate" : "DeserializeFMUState"},
                       {"@BYTE@", two ? "char" : "uint8_t"},
                       {"@VARIABLES@", variable_rows(variables)},
                       {"@COUNT@", std::to_string(variables.size() - 1)},
                       {"@WARMTH@", heat ? "ambient" : "held"},
                       {"@START@", std::string(heat ? "start_degC, " : "") +
                                       (winding ? "winding_start_degC, winding_degC, " : "")},
                       {"@START_VALUE@", start_values(variables)},
                       {"@START_TEMPERATURE@", start_temperatures(d)},
                       {"@RESULTS@", winding ? "  s->winding_degC = @NAME@_winding_temperature(&s->joint);\n" : ""},
                       {"@SURROUNDINGS@", heat ? "  s->joint.ambient_K = s->ambient_degC - @T_AMB@;\n"
                                               : "  @NAME@_set_temperature(&s->joint, s->held_degC);\n"},
                       {"@T_AMB@", c_number(d.thermal.T_amb_degC)},
                       {"@SPEED_MAX@", c_number(drive::slide_speed_max_rad_s)},
                       {"@DT_MAX@", c_number(drive::slide_dt_max_s)},
                       {"@UPPER@", c_upper(name)},
                       {"@NAME@", name}});
}

/// The drive under its keys in MJCF.
std::string keys_of(const drive::Drive& d) {
  std::string text = "# The joint of this FMU, as config keys of a tribotwin.drive.\n";
  for (const auto& [key, value] : drive::configuration_of(d)) text += fmt::format("{}: {}\n", key, value);
  return text;
}

}  // namespace

extern const char* const license_text;  // LICENSE, by CMake

std::string fmu_token(const std::vector<FmuFile>& files) {
  std::string all;
  for (const FmuFile& file : files) all += file.name + file.content;
  return fmt::format("{{{}}}",
                     boost::uuids::to_string(boost::uuids::name_generator_sha1(boost::uuids::ns::oid())(all)));
}

std::string fmu_license(const std::string& of) {
  return fmt::format(
      "The sources of this FMU and what is compiled of them were written by tribotwin under the license below.\nThe {} "
      "are those of whoever exported it.\n\n{}",
      of, license_text);
}

Result<std::vector<FmuFile>> fmu_files(const drive::Drive& d, const std::string& name, FmiVersion version) {
  const auto joint = c_source(d, name, JointNumbers::members);
  if (!joint) return tl::unexpected(joint.error());
  const int number = static_cast<int>(version);
  std::vector<FmuFile> files{{"modelDescription.xml", fmu_description(d, name, number)},
                             {fmt::format("sources/{}.c", name), *joint},
                             {fmt::format("sources/fmi{}.c", number), functions_of(d, name, version)},
                             {"resources/joint.yaml", keys_of(d)}};
  if (version == FmiVersion::three) files.push_back({"sources/buildDescription.xml", fmu_build_description(name)});
  const std::string token = fmu_token(files);
  for (FmuFile& file : files) file.content = filled(file.content, {{"@TOKEN@", token}});
  files.push_back({"documentation/index.html", fmu_page(d, name)});
  files.push_back({"documentation/licenses/license.txt", fmu_license("numbers of the joint")});
  return files;
}

}  // namespace tribotwin::twin
