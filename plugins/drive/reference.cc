#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/drive/configuration.hpp>
#include <tribotwin/plugins/drive/keys.hpp>
#include <tribotwin/plugins/transmission/hysteresis.hpp>

namespace tribotwin::drive {
namespace {

std::string bound(double x) { return std::isinf(x) ? std::string("any") : fmt::format("{:g}", x); }

std::string key_table() {
  std::string out = "### Keys of every drive\n\n| key | unit | default | range | meaning |\n|---|---|---|---|---|\n";
  for (const Key& key : word_keys())
    out += fmt::format("| `{}` | | {} | | {} |\n", key.name, key.fallback[0] ? key.fallback : "required",
                       key.name == std::string_view("thermal") ? thermal::model_names() : key.meaning);
  for (const Key& key : number_keys())
    out += fmt::format("| `{}` | {} | {} | {:g} .. {:g} | {} |\n", key.name, key.unit,
                       key.fallback[0] ? key.fallback : "required", key.minimum, key.maximum, key.meaning);
  for (const Key& key : winding_keys())
    out +=
        fmt::format("| `{}` | {} | {} | {:g} .. {:g} | {} |\n", key.name, key.unit,
                    key.fallback[0] ? key.fallback : "required with a winding", key.minimum, key.maximum, key.meaning);
  for (const Key& key : list_keys())
    out += fmt::format("| `{}` | {} | no table | {:g} .. {:g} | {} |\n", key.name, key.unit, key.minimum, key.maximum,
                       key.meaning);
  return out;
}

std::string dynamics_reference() {
  std::string out =
      "\n### Dynamic friction\n\nOver any law, with g its weakening and h its strengthening part, w the speed on its "
      "side.\n\n"
      "- `lugre` (RH380-N study (5)): `z' = w - sigma0 |w| z / g`, `tau_f = sigma0 z + sigma1 e^-(w/vd)^2 z' + h`\n"
      "- `gear_loss` (google-deepmind/mujoco issue 3528): `z' = (w - |w| z) / h`, `tau_f = (g + mu_avg |tau|) z + "
      "mu_dif tau z^2 +` the h of the law\n\n"
      "| `friction` | key | unit | range | meaning |\n|---|---|---|---|---|\n";
  for (const DynamicsInfo& info : dynamics_table())
    for (const Key& key : info.keys)
      out += fmt::format("| `{}` | `{}` | {} | {:g} .. {:g} | {} |\n", info.name, key.name, key.unit, key.minimum,
                         key.maximum, key.meaning);
  return out;
}

std::string thermal_reference() {
  std::string out =
      "\n### Thermal models\n\n| `thermal` | key | unit | range | meaning | source |\n|---|---|---|---|---|---|\n";
  for (const auto& model : thermal::models()) {
    if (model.parameters.empty()) out += fmt::format("| `{}` | | | | {} | |\n", model.name, model.meaning);
    for (const auto& p : model.parameters)
      out += fmt::format("| `{}` | `{}` | {} | {:g} .. {:g} | {} | {} |\n", model.name, p.name, p.unit, p.minimum,
                         p.maximum, p.meaning, p.source);
  }
  return out;
}

std::string law_reference() {
  std::string out = "\n### Friction laws\n";
  for (const auto& law : friction::laws()) {
    out += fmt::format(
        "\n#### `{}`\n\n`{}` ({})\n\nSpeed v on the {} side [rad/s], torque {}. Identified for speeds up to "
        "{} rad/s",
        law.name, law.equation, law.source, law.side == friction::Side::motor ? "motor" : "arm",
        law.normalised ? "over torque_max_nm, load l = |tau_m| / torque_max_nm" : "in Nm, arm side",
        bound(law.identified.speed_max_rad_s));
    if (law.load_dependent) out += fmt::format(", loads up to {}", bound(law.identified.load_max));
    if (law.temperature_dependent && std::isfinite(law.identified.temperature_min_degC))
      out += fmt::format(", {} .. {} degC", bound(law.identified.temperature_min_degC),
                         bound(law.identified.temperature_max_degC));
    out += ".\n\n| key | unit | range | published | meaning |\n|---|---|---|---|---|\n";
    for (const auto& p : law.parameters) {
      std::string published = std::isnan(p.published) ? "" : fmt::format("{:g}", p.published);
      if (!std::isnan(p.sigma)) published += fmt::format(" +- {:g}", p.sigma);
      out += fmt::format("| `{}` | {} | {:g} .. {:g} | {} | {} |\n", p.name, p.unit, p.minimum, p.maximum, published,
                         p.meaning);
    }
  }
  return out;
}

}  // namespace

std::string reference_markdown() {
  return key_table() + dynamics_reference() + thermal_reference() + law_reference() +
         transmission::reference_markdown();
}

}  // namespace tribotwin::drive
