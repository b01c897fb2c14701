#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/tables/column.hpp>
#include <tribotwin/twin/io/tables/table_options.hpp>

namespace tribotwin::twin {

Result<PerJoint> PerJoint::of(std::string_view option, const std::vector<std::string>& texts) {
  PerJoint out;
  for (const std::string& text : texts) {
    const auto sign = text.rfind('=');
    const std::string_view number = std::string_view(text).substr(sign == text.npos ? 0 : sign + 1);
    const auto value = to_number(number);
    if (!value || !std::isfinite(*value) || !(*value > 0) || *value > 1e9 || sign == 0)
      return tl::unexpected(
          fmt::format("{} {}: must be NUMBER or JOINT=NUMBER, above 0 and at most 1e9", option, shown(text)));
    const std::string joint = sign == text.npos ? "" : text.substr(0, sign);
    if ((joint.empty() && out.all_) ||
        std::ranges::find(out.named_, joint, [](const auto& entry) { return entry.first; }) != out.named_.end())
      return tl::unexpected(fmt::format("{} {}: is given twice", option, shown(text)));
    if (joint.empty())
      out.all_ = *value;
    else
      out.named_.emplace_back(joint, *value);
    out.given_ = true;
  }
  return out;
}

std::optional<double> PerJoint::find(std::string_view joint) const {
  for (const auto& [name, value] : named_)
    if (name == joint) return value;
  if (all_) return all_;
  for (const auto& [name, value] : defaults_)
    if (name == joint) return value;
  return std::nullopt;
}

void PerJoint::add_default(std::string joint, double value) { defaults_.emplace_back(std::move(joint), value); }

TableOptions with_gear_ratio(TableOptions options, double gear_ratio) {
  if (gear_ratio > 0 && !options.gear_ratio.given()) options.gear_ratio.set_all(gear_ratio);
  return options;
}

Result<TableOptions> TableArguments::options() const {
  auto constant = PerJoint::of("--torque-constant", torque_constant), gear = PerJoint::of("--gear-ratio", gear_ratio);
  for (const auto* option : {&constant, &gear})
    if (!*option) return tl::unexpected(option->error());
  return TableOptions{.columns = columns,
                      .torque_constant = std::move(*constant),
                      .gear_ratio = std::move(*gear),
                      .joint = {},
                      .topic = topic};
}

}  // namespace tribotwin::twin
