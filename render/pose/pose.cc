#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/render/pose/overlay.hpp>
#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/twin/robot/arm.hpp>

namespace tribotwin::render {
namespace {

constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

double shown_value(const mujoco::Binding& drive, const JointState& joint, ColourBy by) {
  switch (by) {
    case ColourBy::temperature:
      return joint.temperature_degC;
    case ColourBy::friction:
      return 100 * std::abs(joint.friction_nm) / drive.drive.torque_max_nm;
    case ColourBy::nothing:
      break;
  }
  return unknown;
}

double share(const Scale& scale, double value) { return (value - scale.from) / (scale.to - scale.from); }

/// To a thousandth of the drive's torque.
std::string torque_text(double torque_nm, double torque_max_nm, bool slide) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(3 - std::log10(torque_max_nm))), 0, 6);
  return fmt::format("{:.{}f} {}", std::abs(torque_nm), decimals, twin::unit_of("Nm", slide));
}

std::vector<int> housing(const mjModel* m, int joint, const std::string& name) {
  if (const int geom = mj_name2id(m, mjOBJ_GEOM, ("housing_" + name).c_str()); geom >= 0) return {geom};
  std::vector<int> geoms;
  const int body = m->jnt_bodyid[joint];
  for (int i = 0; i < m->body_geomnum[body]; ++i) geoms.push_back(m->body_geomadr[body] + i);
  return geoms;
}

ColourBar bar_of(ColourBy by, Scale scale) {
  return {by == ColourBy::temperature ? "lubricant temperature [°C]" : "friction / maximum torque [%]", scale.from,
          scale.to};
}

}  // namespace

PoseState rest(const mujoco::Model& model) {
  const auto d = model.make_data();
  const mjModel* m = model.get();
  if (const int home = mj_name2id(m, mjOBJ_KEY, "home"); home >= 0) mj_resetDataKeyframe(m, d.get(), home);
  PoseState state{{d->qpos, d->qpos + m->nq}, std::nullopt, {}};
  for (const auto& drive : model.drives())
    state.joints.push_back(
        {twin::joint_name(m, drive), drive::temperature_degC(drive.drive, mujoco::state(d.get(), drive)), unknown});
  return state;
}

PoseState recorded(const mujoco::Model& model, const twin::Recording& record, std::size_t index) {
  return recorded(model, record, index, rest(model));
}

PoseState recorded(const mujoco::Model& model, const twin::Recording& record, std::size_t index, PoseState state) {
  state.time_s = record.time_s.at(index);
  for (std::size_t i = 0; i < state.joints.size(); ++i) {
    auto& joint = state.joints[i];
    const auto at = [&](const char* channel) {
      const auto values = record.channel(joint.name, channel);
      return index < values.size() ? values[index] : unknown;
    };
    if (const double q = at("position_rad"); std::isfinite(q))
      state.qpos[static_cast<std::size_t>(twin::position_address(model.get(), model.drives()[i]))] = q;
    joint.temperature_degC = at("temperature_degC");
    joint.friction_nm = at("friction_nm");
  }
  return state;
}

Scale scale_around(std::span<const double> values) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double v : values)
    if (std::isfinite(v)) low = std::min(low, v), high = std::max(high, v);
  if (low > high) return {};
  if (high - low < 5) {
    const double middle = (low + high) / 2;
    low = middle - 2.5, high = middle + 2.5;
  }
  const auto marks = ticks(low, high, 6);
  const double step = marks.size() > 1 ? marks[1] - marks[0] : high - low;
  return {step * std::floor(low / step + 1e-9), step * std::ceil(high / step - 1e-9)};
}

Scale magnitudes_around(std::span<const double> values) {
  Scale scale = scale_around(values);
  if (scale.from < 0) scale = {0, scale.to - scale.from};
  return scale;
}

Scale scale_of(const mujoco::Model& model, const twin::Recording& record, ColourBy by) {
  std::vector<double> values;
  const char* channel = by == ColourBy::friction ? "friction_nm" : "temperature_degC";
  for (const auto& drive : model.drives()) {
    JointState joint{twin::joint_name(model.get(), drive), unknown, unknown};
    for (const double v : record.channel(joint.name, channel)) {
      joint.temperature_degC = joint.friction_nm = v;
      values.push_back(shown_value(drive, joint, by));
    }
  }
  return by == ColourBy::friction ? magnitudes_around(values) : scale_around(values);
}

Scale scale_of(const mujoco::Model& model, const PoseState& state, ColourBy by) {
  std::vector<double> values;
  for (std::size_t i = 0; i < state.joints.size(); ++i)
    values.push_back(shown_value(model.drives()[i], state.joints[i], by));
  return by == ColourBy::friction ? magnitudes_around(values) : scale_around(values);
}

std::vector<Point> outline(const mujoco::Model& model, const twin::Recording& record) {
  constexpr std::size_t poses = 24;
  const auto d = model.make_data();
  std::vector<Point> points;
  for (const std::size_t index : evenly_in_time(record.time_s, poses)) {
    std::ranges::copy(recorded(model, record, index).qpos, d->qpos);
    mj_kinematics(model.get(), d.get());
    std::ranges::copy(outline(model.get(), d.get()), std::back_inserter(points));
  }
  return points;
}

std::string beyond_range(const mujoco::Model& model, const PoseState& state) {
  const mjModel* m = model.get();
  std::string text;
  for (int j = 0; j < m->njnt; ++j) {
    const bool slide = m->jnt_type[j] == mjJNT_SLIDE;
    if (!m->jnt_limited[j] || (m->jnt_type[j] != mjJNT_HINGE && !slide)) continue;
    const double q = state.qpos[static_cast<std::size_t>(m->jnt_qposadr[j])], low = m->jnt_range[2 * j],
                 high = m->jnt_range[2 * j + 1], slack = 1e-3 * (high - low);
    if (q >= low - slack && q <= high + slack) continue;
    const char* name = mj_id2name(m, mjOBJ_JOINT, j);
    text += fmt::format("{}{} ({:.4g} {}, range {:.4g} .. {:.4g})", text.empty() ? "" : ", ",
                        name ? name : fmt::format("joint_{}", j), q, twin::unit_of("rad", slide), low, high);
  }
  return text;
}

PosePainter::PosePainter(std::shared_ptr<const mujoco::Model> model, Size size, Renderer renderer)
    : model_(std::move(model)), size_(size), renderer_(std::move(renderer)), data_(model_->make_data()) {}

Result<PosePainter> PosePainter::create(std::shared_ptr<const mujoco::Model> model, Size size, Quality quality) {
  auto renderer = Renderer::create(model->get(), size, quality);
  if (!renderer) return tl::unexpected(renderer.error());
  return PosePainter(std::move(model), size, std::move(*renderer));
}

Result<Image> PosePainter::draw(const PoseState& state, const PoseOptions& options) {
  const mjModel* m = model_->get();
  if (state.qpos.size() != static_cast<std::size_t>(m->nq))
    return tl::unexpected(fmt::format("a pose of {} coordinates: the model has {}", state.qpos.size(), m->nq));
  std::ranges::copy(state.qpos, data_->qpos);
  pose_kinematics(m, data_.get());

  std::vector<Paint> paints;
  std::vector<PanelRow> rows;
  const bool coloured = options.colour_by != ColourBy::nothing;
  for (std::size_t i = 0; i < state.joints.size(); ++i) {
    const auto& joint = state.joints[i];
    const auto& drive = model_->drives()[i];
    const double value = shown_value(drive, joint, options.colour_by);
    const Colour colour = viridis(share(options.scale, value));
    if (std::isfinite(value))
      for (const int geom : housing(m, drive.joint, joint.name)) paints.push_back({geom, colour});
    rows.push_back({colour, std::isfinite(value), joint.name,
                    std::isfinite(joint.temperature_degC) ? fmt::format("{:.1f} °C", joint.temperature_degC) : "",
                    std::isfinite(joint.friction_nm)
                        ? torque_text(joint.friction_nm, drive.drive.torque_max_nm, twin::is_slide(m, drive))
                        : ""});
  }
  auto image = renderer_.draw(data_.get(), options.view, paints);
  if (!image) return image;
  const double unit = options.text_scale * size_.height / 960.0;
  if (options.panel) draw_panel(*image, state.time_s ? duration(*state.time_s) : "", rows, unit);
  if (options.legend && coloured) draw_colour_bar(*image, bar_of(options.colour_by, options.scale), unit);
  return image;
}

void PosePainter::resize(Size size) {
  renderer_.resize(size);
  size_ = size;
}

std::vector<std::size_t> evenly_in_time(std::span<const double> time_s, std::size_t count) {
  std::vector<std::size_t> indices;
  if (time_s.empty() || count == 0) return indices;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = time_s.front() + (time_s.back() - time_s.front()) *
                                          (count == 1 ? 1.0 : static_cast<double>(i) / static_cast<double>(count - 1));
    const auto at = std::ranges::lower_bound(time_s, t);
    const std::size_t index = std::min<std::size_t>(static_cast<std::size_t>(at - time_s.begin()), time_s.size() - 1);
    if (indices.empty() || index > indices.back()) indices.push_back(index);
  }
  return indices;
}

Result<Image> contact_sheet(PosePainter& painter, std::span<const PoseState> states, const PoseOptions& options,
                            const std::function<void(double)>& progress) {
  if (states.empty()) return tl::unexpected(Error("a contact sheet needs at least one state"));
  const Size each = painter.size();
  const int n = static_cast<int>(states.size());
  const double unit = options.text_scale * each.height / 480.0;
  const int gap = static_cast<int>(12 * unit), caption = static_cast<int>(34 * unit);
  const bool legend = options.legend && options.colour_by != ColourBy::nothing;
  const int strip = legend ? static_cast<int>(180 * unit) : 0;
  int columns = 1;
  const auto rows_of = [n](int of) { return (n + of - 1) / of; };
  while (columns < n && 1.0 * columns * each.width < 1.3 * rows_of(columns) * each.height) ++columns;
  const int rows = rows_of(columns);
  Image sheet(gap + columns * (each.width + gap) + strip, gap + rows * (each.height + caption + gap));
  if (std::max(sheet.width, sheet.height) > 2 * side_max)
    return tl::unexpected(
        fmt::format("a contact sheet of {} x {} pixels: at most {} a side; choose fewer or smaller poses", sheet.width,
                    sheet.height, 2 * side_max));
  for (std::size_t i = 0; i < sheet.rgb.size(); i += 3) {
    sheet.rgb[i] = theme::page.r;
    sheet.rgb[i + 1] = theme::page.g;
    sheet.rgb[i + 2] = theme::page.b;
  }
  PoseOptions single = options;
  single.legend = single.panel = false;
  for (int i = 0; i < n; ++i) {
    const PoseState& state = states[static_cast<std::size_t>(i)];
    const auto image = painter.draw(state, single);
    if (!image) return image;
    const int x = gap + i % columns * (each.width + gap), y = gap + i / columns * (each.height + caption + gap);
    paste(sheet, *image, x, y);
    std::string text = duration(*state.time_s);
    if (options.colour_by != ColourBy::nothing && !state.joints.empty()) {
      const auto value = [&](const JointState& j) {
        const double v = shown_value(painter.model().drives()[static_cast<std::size_t>(&j - state.joints.data())], j,
                                     options.colour_by);
        return std::isfinite(v) ? v : -std::numeric_limits<double>::infinity();
      };
      const auto& top = *std::ranges::max_element(state.joints, {}, value);
      if (std::isfinite(value(top))) {
        const bool degrees = options.colour_by == ColourBy::temperature;
        const std::string most = fmt::format("{:.1f}", value(top));
        const auto as_much = std::ranges::count(state.joints, most,
                                                [&](const JointState& j) { return fmt::format("{:.1f}", value(j)); });
        const bool all = as_much > 1 && as_much == std::ssize(state.joints);
        text += fmt::format(" · {}{}{}{} {}",
                            all       ? "all joints"
                            : degrees ? "warmest: "
                                      : "maximum: ",
                            all ? "" : top.name, all || as_much == 1 ? "" : fmt::format(" and {} more", as_much - 1),
                            all ? ": " + most : ", " + most, degrees ? "°C" : "%");
      }
    }
    draw_text(sheet, text, x + 2 * unit, y + each.height + 5 * unit, unit);
    if (progress) progress((i + 1.0) / n);
  }
  if (legend) draw_colour_bar(sheet, bar_of(options.colour_by, options.scale), unit);
  return sheet;
}

}  // namespace tribotwin::render
