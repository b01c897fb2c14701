#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/portable/fmu_variables.hpp>

namespace tribotwin::twin {
namespace {

/// For an attribute or a text of XML.
std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  return out;
}

/// What the standard calls a kind of variable.
struct Words {
  const char *causality, *variability, *initial;
};
Words words_of(const FmuVariable& v) {
  switch (v.kind) {
    case FmuKind::independent:
      return {"independent", "continuous", ""};
    case FmuKind::input:
      return {"input", "continuous", ""};
    case FmuKind::tunable:
      return {"parameter", "tunable", "exact"};
    case FmuKind::fixed:
      return {"parameter", "fixed", "exact"};
    case FmuKind::output:
      return {"output", v.unit.empty() ? "discrete" : "continuous", "calculated"};
    case FmuKind::local:
      break;
  }
  return {"local", "continuous", "calculated"};
}

std::string attribute(const char* name, const std::string& value) {
  return value.empty() ? "" : fmt::format(" {}=\"{}\"", name, escaped(value));
}

/// Those of the type: unit, range and start.
std::string of_type(const FmuVariable& v) {
  if (v.unit.empty()) return "";
  std::string text = attribute("unit", fmu_unit(v.unit).name);
  if (std::isfinite(v.minimum)) text += fmt::format(" min=\"{}\"", v.minimum);
  if (std::isfinite(v.maximum)) text += fmt::format(" max=\"{}\"", v.maximum);
  if (v.kind == FmuKind::input || v.kind == FmuKind::tunable || v.kind == FmuKind::fixed)
    text += fmt::format(" start=\"{}\"", v.start);
  return text;
}

std::string variable(const FmuVariable& v, std::size_t reference, int version) {
  const Words words = words_of(v);
  const std::string head = attribute("name", v.name) + fmt::format(" valueReference=\"{}\"", reference) +
                           attribute("description", v.meaning) + attribute("causality", words.causality) +
                           attribute("variability", words.variability) + attribute("initial", words.initial);
  if (version == 3) return fmt::format("    <{}{}{}/>\n", v.unit.empty() ? "Boolean" : "Float64", head, of_type(v));
  return fmt::format("    <ScalarVariable{}>\n      <{}{}/>\n    </ScalarVariable>\n", head,
                     v.unit.empty() ? "Boolean" : "Real", of_type(v));
}

std::string unit_definitions(const std::vector<FmuVariable>& variables) {
  std::vector<std::string> named;
  std::string text = "  <UnitDefinitions>\n";
  for (const FmuVariable& v : variables) {
    const FmuUnit u = fmu_unit(v.unit);
    if (v.unit.empty() || std::ranges::find(named, u.name) != named.end()) continue;
    named.push_back(u.name);
    text += "    <Unit" + attribute("name", u.name);
    if (!u.known) {
      text += "/>\n";
      continue;
    }
    text += ">\n      <BaseUnit";
    const std::pair<const char*, int> powers[] = {{"kg", u.kg}, {"m", u.m}, {"s", u.s},
                                                  {"A", u.A},   {"K", u.K}, {"rad", u.rad}};
    for (const auto& [base, power] : powers)
      if (power != 0) text += fmt::format(" {}=\"{}\"", base, power);
    if (u.offset != 0) text += fmt::format(" offset=\"{}\"", u.offset);
    text += "/>\n    </Unit>\n";
  }
  return text + "  </UnitDefinitions>\n";
}

/// Outputs are those of the last step, so none depends on an input of now; at the start they do on all.
std::string structure(const std::vector<FmuVariable>& variables, int version) {
  std::string outputs, initial;
  for (std::size_t i = 0; i < variables.size(); ++i) {
    if (variables[i].kind != FmuKind::output) continue;
    if (version == 3) {
      outputs += fmt::format("    <Output valueReference=\"{}\" dependencies=\"\"/>\n", i);
      initial += fmt::format("    <InitialUnknown valueReference=\"{}\"/>\n", i);
    } else {
      outputs += fmt::format("      <Unknown index=\"{}\" dependencies=\"\"/>\n", i + 1);
      initial += fmt::format("      <Unknown index=\"{}\"/>\n", i + 1);
    }
  }
  if (version == 3) return "  <ModelStructure>\n" + outputs + initial + "  </ModelStructure>\n";
  return "  <ModelStructure>\n    <Outputs>\n" + outputs + "    </Outputs>\n    <InitialUnknowns>\n" + initial +
         "    </InitialUnknowns>\n  </ModelStructure>\n";
}

constexpr const char* co_simulation_2 = R"(  <CoSimulation modelIdentifier="{0}" needsExecutionTool="false"
      canHandleVariableCommunicationStepSize="true" canInterpolateInputs="false" maxOutputDerivativeOrder="0"
      canRunAsynchronuously="false" canBeInstantiatedOnlyOncePerProcess="false"
      canNotUseMemoryManagementFunctions="true" canGetAndSetFMUstate="{1}" canSerializeFMUstate="{1}"
      providesDirectionalDerivative="false">
{2}  </CoSimulation>
)";
constexpr const char* source_files_2 = R"(    <SourceFiles>
      <File name="fmi2.c"/>
      <File name="{0}.c"/>
    </SourceFiles>
)";

constexpr const char* co_simulation_3 = R"(  <CoSimulation modelIdentifier="{0}" needsExecutionTool="false"
      canBeInstantiatedOnlyOncePerProcess="false" canGetAndSetFMUState="{1}" canSerializeFMUState="{1}"{2}
      providesDirectionalDerivatives="false" providesAdjointDerivatives="false"
      canHandleVariableCommunicationStepSize="true" maxOutputDerivativeOrder="0" providesIntermediateUpdate="false"
      mightReturnEarlyFromDoStep="false" canReturnEarlyAfterIntermediateUpdate="false" hasEventMode="false"/>
)";

constexpr const char* logs = R"(  <LogCategories>
    <Category name="logStatusError" description="calls that are wrong"/>
    <Category name="logStatusDiscard" description="values that are refused"/>
  </LogCategories>
  <DefaultExperiment startTime="0" stopTime="{}" stepSize="{}"/>
)";

std::string co_simulation(const FmuAbout& about, int version) {
  const char* states = about.states ? "true" : "false";
  if (version == 2)
    return fmt::format(co_simulation_2, about.name, states,
                       about.sources ? fmt::format(source_files_2, about.name) : "");
  return fmt::format(co_simulation_3, about.name, states,
                     about.fixed_step_s > 0 ? fmt::format(" fixedInternalStepSize=\"{}\"", about.fixed_step_s) : "");
}

}  // namespace

std::string fmu_description(const FmuAbout& about, const std::vector<FmuVariable>& variables, int version) {
  std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  text += fmt::format("<fmiModelDescription fmiVersion=\"{}.0\" modelName=\"{}\" {}=\"@TOKEN@\"\n   ", version,
                      about.name, version == 3 ? "instantiationToken" : "guid");
  text += attribute("description", about.text) + " license=\"documentation/licenses/license.txt\"";
  text += "\n    generationTool=\"tribotwin\" variableNamingConvention=\"flat\"";
  text += version == 3 ? ">\n" : " numberOfEventIndicators=\"0\">\n";
  text += co_simulation(about, version) + unit_definitions(variables);
  text += fmt::format(logs, about.stop_s, about.step_s) + "  <ModelVariables>\n";
  for (std::size_t i = 0; i < variables.size(); ++i) text += variable(variables[i], i, version);
  return text + "  </ModelVariables>\n" + structure(variables, version) + "</fmiModelDescription>\n";
}

std::string fmu_description(const drive::Drive& d, const std::string& name, int version) {
  const std::string about = fmt::format("friction of a robot joint: law {}, {}; thermal model {}", d.law.info->name,
                                        d.law.info->equation, thermal::name(d.thermal.order));
  return fmu_description({.name = name, .text = about}, fmu_variables(d), version);
}

std::string fmu_build_description(const std::string& name) {
  return fmt::format(R"(<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{0}">
    <SourceFileSet language="C99">
      <SourceFile name="fmi3.c"/>
      <SourceFile name="{0}.c"/>
    </SourceFileSet>
    <Library name="m"/>
  </BuildConfiguration>
</fmiBuildDescription>
)",
                     name);
}

std::string fmu_variable_rows(const std::vector<FmuVariable>& variables) {
  std::string rows;
  for (const FmuVariable& v : variables) {
    const Words words = words_of(v);
    rows += fmt::format("<tr><td>{}</td><td>{}</td><td>{}, {}</td><td>{}</td></tr>\n", escaped(v.name),
                        escaped(v.unit.empty() ? "Boolean" : v.unit), words.causality, words.variability,
                        escaped(v.meaning));
  }
  return rows;
}

std::string fmu_page(const drive::Drive& d, const std::string& name) {
  return fmt::format(R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{0}</title></head><body>
<h1>{0}</h1>
<p>Friction of a robot joint: law {1}, {2} (from: {3}). Written by <code>tribotwin export --fmu</code>.</p>
<p>A step takes speed and load as constant, from its beginning on. Outputs are those of the last step: apply
<code>friction_nm</code> to the arm against its motion in the same step. Torques are those of the arm side. Tunable
parameters may change between steps, each within its range; conditions between several of them are not checked. Not part
of <code>friction_nm</code>: the drive's offset, {4} Nm against positive motion.</p>
<p>The numbers are those of tribotwin, bit by bit where compiler and libm are. Do not let a compiler contract or reorder
operations (-ffp-contract=off).</p>
<table border="1"><tr><th>name</th><th>unit</th><th>kind</th><th>meaning</th></tr>
{5}</table>
</body></html>
)",
                     name, escaped(d.law.info->name), escaped(d.law.info->equation), escaped(d.law.info->source),
                     d.offset_nm, fmu_variable_rows(fmu_variables(d)));
}

}  // namespace tribotwin::twin
