#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/plugins/friction/text.hpp>
#include <tribotwin/twin/diagnosis/fleet/reader.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>
#include <tribotwin/twin/io/tables/rows.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

namespace fs = std::filesystem;

/// The columns of a level. In the order of Cells.
enum Column { speed, friction_nm, friction_norm, load_norm, temperature, stderr_nm, ripple_nm, lost_motion, columns };
struct ColumnInfo {
  std::string_view name;
  double minimum, maximum;
};
constexpr double any = 1e9;
constexpr std::array<ColumnInfo, columns> level_columns{{{"speed_rad_s", -1e6, 1e6},
                                                         {"friction_nm", -any, any},
                                                         {"friction_norm", -100, 100},
                                                         {"load_norm", -100, 100},
                                                         {"temperature_degC", -100, 300},
                                                         {"stderr_nm", 1e-12, any},
                                                         {"ripple_nm", 0, any},
                                                         {"lost_motion_rad", 0, 10}}};
using Cells = std::array<double, columns>;

/// What every origin of levels ends in.
class LevelAdder {
 public:
  LevelAdder(const ReaderOptions& options, std::array<bool, columns> has) : options_(options), has_(has) {}

  /// Why the columns are not those of friction curves.
  std::optional<std::string> lacking() const {
    if (!has_[speed]) return "no column speed_rad_s";
    if (!has_[friction_nm] && !has_[friction_norm]) return "no column friction_nm";
    if (!has_[friction_nm] && !(options_.torque_max_nm > 0))
      return "friction_norm, but no friction_nm: give the joint's largest torque with --tau-max";
    return std::nullopt;
  }

  /// Why the row is no level.
  std::optional<std::string> add(const Cells& cells, LevelCurve& c) const {
    for (std::size_t k = 0; k < columns; ++k)
      if (has_[k] && !(cells[k] >= level_columns[k].minimum && cells[k] <= level_columns[k].maximum))
        return std::isfinite(cells[k])
                   ? fmt::format("{} is {}; it must be a number within {:g} .. {:g}", level_columns[k].name, cells[k],
                                 level_columns[k].minimum, level_columns[k].maximum)
                   : fmt::format("{} is not a number; measure this level again, or take its whole curve out",
                                 level_columns[k].name);
    const double v = cells[speed];
    const double friction =
        (v < 0 ? -1 : 1) * (has_[friction_nm] ? cells[friction_nm] : cells[friction_norm] * options_.torque_max_nm);
    if (v == 0) return "speed_rad_s is 0: friction is measured in motion";
    if (!(friction > 0))
      return fmt::format("friction of {:g} Nm at {:g} rad/s drives the motion: it must have the sign of the speed",
                         v < 0 ? -friction : friction, v);
    c.speed_rad_s.push_back(std::abs(v)), c.friction_nm.push_back(friction);
    if (has_[load_norm]) c.load_norm.push_back(std::abs(cells[load_norm]));
    if (has_[temperature]) c.temperature_degC.push_back(cells[temperature]);
    if (has_[stderr_nm]) c.stderr_nm.push_back(cells[stderr_nm]);
    if (has_[ripple_nm]) c.ripple_nm.push_back(cells[ripple_nm]);
    if (has_[lost_motion]) c.lost_motion_rad.push_back(cells[lost_motion]);
    return std::nullopt;
  }

 private:
  const ReaderOptions options_;
  const std::array<bool, columns> has_;
};

Error wrong(const std::string& where, const std::string& what) { return Error(fmt::format("{}: {}", where, what)); }

/// One table of a whole fleet, read row by row.
class FleetTable final : public CurveReader {
 public:
  static Result<std::unique_ptr<CurveReader>> open(const fs::path& file, const ReaderOptions& options) {
    TableRows::Wanted wanted{.texts = {names.begin(), names.end()}, .numbers = {}};
    for (const auto& c : level_columns) wanted.numbers.emplace_back(c.name);
    auto rows = TableRows::open(file, wanted, options.columns);
    if (!rows) return tl::unexpected(rows.error());
    std::array<bool, columns> has{};
    for (std::size_t k = 0; k < columns; ++k) has[k] = (*rows)->has_number(k);
    LevelAdder adder(options, has);
    for (const std::size_t k : {robot, joint, date})
      if (!(*rows)->has_text(k))
        return tl::unexpected(wrong(file.string() + ":1", fmt::format("no column {}; a fleet's table has robot, joint, "
                                                                      "date, speed_rad_s, friction_nm, load_norm, "
                                                                      "temperature_degC",
                                                                      names[k])));
    if (const auto problem = adder.lacking()) return tl::unexpected(wrong(file.string() + ":1", *problem));
    return std::unique_ptr<CurveReader>(new FleetTable(file, *std::move(rows), std::move(adder)));
  }

  Result<bool> next(LevelCurve& out) override {
    out = std::exchange(begun_, {});
    for (;;) {
      const auto more = rows_->next();
      if (!more) return tl::unexpected(more.error());
      if (!*more) return !out.speed_rad_s.empty();
      const bool same = !out.speed_rad_s.empty() && same_as_before();
      if (!same) {
        begun_.file = file_, begun_.line = rows_->line();
        if (const auto problem = take_key()) return tl::unexpected(wrong(rows_->where(), *problem));
      }
      for (std::size_t k = 0; k < columns; ++k) cells_[k] = rows_->number(k);
      if (const auto problem = adder_.add(cells_, same ? out : begun_))
        return tl::unexpected(wrong(rows_->where(), *problem));
      if (same) continue;
      if (!out.speed_rad_s.empty()) return true;
      out = std::exchange(begun_, {});
    }
  }

 private:
  enum Name { robot, joint, date, type, curve };
  static constexpr std::array<std::string_view, 5> names{"robot", "joint", "date", "type", "curve"};

  FleetTable(const fs::path& file, std::unique_ptr<TableRows> rows, LevelAdder adder)
      : file_(file.string()), rows_(std::move(rows)), adder_(std::move(adder)) {}

  bool same_as_before() const {
    for (std::size_t k = 0; k < names.size(); ++k)
      if (rows_->text(k) != last_[k]) return false;
    return true;
  }

  std::optional<std::string> take_key() {
    for (std::size_t k = 0; k < names.size(); ++k) last_[k] = rows_->text(k);
    for (const std::size_t k : {robot, joint})
      if (last_[k].empty()) return fmt::format("{} is empty; write its name", names[k]);
    const auto time_s = to_time(last_[date]);
    if (!time_s) return fmt::format("date is {}; write 2026-11-23 or 2026-11-23T08:17", shown(last_[date]));
    const auto number = last_[curve].empty() ? 1 : to_integer<std::uint32_t>(last_[curve]);
    if (!number || *number == 0) return fmt::format("curve is {}; write its number, from 1", shown(last_[curve]));
    begun_.key = {last_[type], last_[robot], last_[joint], *time_s, *number};
    return std::nullopt;
  }

  const std::string file_;
  const std::unique_ptr<TableRows> rows_;
  const LevelAdder adder_;
  Cells cells_{};
  std::array<std::string, names.size()> last_;
  LevelCurve begun_;
};

/// A folder ROBOT/JOINT/DATE.csv.
class FleetFolder final : public CurveReader {
 public:
  static Result<std::unique_ptr<CurveReader>> open(const fs::path& folder, const ReaderOptions& options) {
    auto out = std::unique_ptr<FleetFolder>(new FleetFolder(folder, options));
    if (auto ok = out->find_files(); !ok) return tl::unexpected(ok.error());
    if (out->files_.empty())
      return tl::unexpected(wrong(folder.string(), "holds no files; a fleet's folder holds ROBOT/JOINT/DATE.csv"));
    std::ranges::sort(out->files_);
    return std::unique_ptr<CurveReader>(std::move(out));
  }

  Result<bool> next(LevelCurve& out) override {
    while (at_ == curves_.size()) {
      if (file_ == files_.size()) return false;
      if (auto read = read_file(files_[file_++]); !read) return tl::unexpected(read.error());
    }
    out = std::move(curves_[at_++]);
    return true;
  }

 private:
  FleetFolder(fs::path folder, const ReaderOptions& options) : folder_(std::move(folder)), options_(options) {}

  Result<void> find_files() {
    for (std::vector<fs::path> folders{folder_}; !folders.empty();) {
      const auto entries = entries_of(folders.back());
      folders.pop_back();
      if (!entries) return tl::unexpected(entries.error());
      std::error_code error;
      for (const fs::directory_entry& entry : *entries) {
        if (entry.path().filename().string().starts_with('.')) continue;
        if (entry.is_directory(error) && !entry.is_symlink(error)) folders.push_back(entry.path());
        if (entry.is_regular_file(error)) files_.push_back(entry.path());
      }
    }
    return {};
  }

  Result<Key> key_of(const fs::path& file) const {
    const fs::path name = fs::relative(file, folder_);
    const std::vector<fs::path> parts(name.begin(), name.end());
    if (parts.size() != 3)
      return tl::unexpected(wrong(file.string(), "a fleet's folder holds ROBOT/JOINT/DATE.csv and nothing else"));
    const auto time_s = to_time(parts[2].stem().string());
    if (!time_s)
      return tl::unexpected(wrong(file.string(), "the name must be the date, 2026-11-23.csv or 2026-11-23T08-17.csv"));
    return Key{.type = {}, .robot = parts[0].string(), .joint = parts[1].string(), .time_s = *time_s};
  }

  Result<void> read_file(const fs::path& file) {
    const auto key = key_of(file);
    if (!key) return tl::unexpected(key.error());
    std::vector<std::string> wanted{"curve"};
    for (const auto& c : level_columns) wanted.emplace_back(c.name);
    const auto table =
        read_numbers(file, wanted, {.columns = options_.columns, .torque_constant = {}, .gear_ratio = {}});
    if (!table) return tl::unexpected(table.error());
    if (table->left_out)
      return tl::unexpected(wrong(fmt::format("{}:{}", file.string(), table->first_left_out),
                                  "a cell is empty, NaN or infinite: measure these levels again, or take their whole "
                                  "curve out"));
    std::array<bool, columns> has{};
    for (std::size_t k = 0; k < columns; ++k) has[k] = !table->columns[k + 1].empty();
    const LevelAdder adder(options_, has);
    if (const auto problem = adder.lacking()) return tl::unexpected(wrong(file.string() + ":1", *problem));
    curves_.clear(), at_ = 0;
    const auto& number = table->columns[0];
    for (std::size_t i = 0; i < table->lines.size(); ++i) {
      if (i == 0 || (!number.empty() && number[i] != number[i - 1])) {
        auto& curve = curves_.emplace_back(LevelCurve{.key = *key, .file = file.string(), .line = table->lines[i]});
        curve.key.curve = static_cast<std::uint32_t>(curves_.size());
      }
      Cells cells{};
      for (std::size_t k = 0; k < columns; ++k)
        if (has[k]) cells[k] = table->columns[k + 1][i];
      if (const auto problem = adder.add(cells, curves_.back()))
        return tl::unexpected(wrong(fmt::format("{}:{}", file.string(), table->lines[i]), *problem));
    }
    return {};
  }

  const fs::path folder_;
  const ReaderOptions options_;
  std::vector<fs::path> files_;
  std::size_t file_ = 0, at_ = 0;
  std::vector<LevelCurve> curves_;
};

}  // namespace

Result<std::unique_ptr<CurveReader>> open_curves(const fs::path& data, const ReaderOptions& options) {
  std::error_code error;
  if (fs::is_directory(data, error)) return FleetFolder::open(data, options);
  return FleetTable::open(data, options);
}

}  // namespace tribotwin::twin::diagnosis::fleet
