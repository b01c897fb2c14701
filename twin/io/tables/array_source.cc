#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin::tables {

Result<void> ArraySource::read(std::span<const Pick> picks, Numbers& numbers) {
  std::vector<std::vector<double>> all;
  const Pick* first = nullptr;
  std::size_t rows = 0;
  for (const Pick& pick : picks) {
    if (pick.rate_hz > 0) {
      all.emplace_back();
      continue;
    }
    const std::string name = shown(headers()[pick.header]);
    if (pick.date)
      return tl::unexpected(fmt::format("{}: column {}: dates are read from text, this is an array of numbers",
                                        numbers.file.string(), name));
    auto values = column(pick.header);
    if (!values) return tl::unexpected(values.error());
    if (!first) first = &pick, rows = values->size();
    if (values->size() != rows)
      return tl::unexpected(fmt::format("{}: column {} has {} rows, {} has {}; they must be of one length",
                                        numbers.file.string(), name, values->size(), shown(headers()[first->header]),
                                        rows));
    for (std::size_t i = 0; i < values->size(); ++i) {
      const double raw = (*values)[i], x = pick.value(raw);
      if (std::isfinite(x) && !pick.quantity.contains(x))
        return tl::unexpected(fmt::format("{}: row {}: column {} is {}{} but {}", numbers.file.string(), i + 1, name,
                                          raw,
                                          pick.as_it_is ? "" : fmt::format(", which is {:g}{},", x, pick.quantity.unit),
                                          pick.quantity.requirement()));
      (*values)[i] = x;
    }
    all.push_back(std::move(*values));
  }
  for (std::size_t k = 0; k < picks.size(); ++k)
    for (std::size_t i = 0; picks[k].rate_hz > 0 && i < rows; ++i)
      all[k].push_back(static_cast<double>(i) / picks[k].rate_hz);
  for (std::size_t i = 0; i < rows; ++i) {
    if (!std::ranges::all_of(all, [&](const auto& column) { return std::isfinite(column[i]); })) {
      if (numbers.left_out++ == 0) numbers.first_left_out = i + 1;
      continue;
    }
    numbers.lines.push_back(i + 1);
    for (std::size_t k = 0; k < picks.size(); ++k) numbers.columns[picks[k].place].push_back(all[k][i]);
  }
  return {};
}

std::vector<std::size_t> matrix_sides(std::vector<std::size_t> sides) {
  for (std::size_t k = sides.size(); k-- > 0 && sides.size() > 2;)
    if (sides[k] == 1) sides.erase(sides.begin() + static_cast<std::ptrdiff_t>(k));
  return sides;
}

std::string no_matrix(std::span<const std::size_t> sides) {
  std::string product;
  for (const std::size_t side : sides) product += fmt::format("{}{}", product.empty() ? "" : " x ", side);
  return fmt::format("has {} dimensions, {}; columns are read from vectors and matrices: save it as a matrix",
                     sides.size(), product);
}

std::vector<Stripe> stripes_of(const std::string& name, std::span<const std::size_t> sides, bool by_column, char open,
                               char close, std::size_t first) {
  constexpr std::size_t most = 1024, most_rows = 64;
  const std::size_t rows = sides[0], columns = sides.size() > 1 ? sides[1] : 1;
  // A vector, lying or standing, is one column.
  if (rows == 1 || columns == 1 || sides.size() > 2) return {{name, 0, 1, rows * columns}};
  std::vector<Stripe> out;
  for (std::size_t k = 0; k < columns && columns <= most; ++k)
    out.push_back({fmt::format("{}{}:,{}{}", name, open, k + first, close), by_column ? k * rows : k,
                   by_column ? 1 : columns, rows});
  for (std::size_t k = 0; k < rows && rows <= most_rows; ++k)
    out.push_back({fmt::format("{}{}{},:{}", name, open, k + first, close), by_column ? k : k * columns,
                   by_column ? rows : 1, columns});
  return out;
}

namespace {

/// The samples of a run: time_s and JOINT.COLUMN, as in telemetry.csv.
class RecordSource final : public ArraySource {
 public:
  explicit RecordSource(Recording recording) : recording_(std::move(recording)) {
    headers_.emplace_back("time_s");
    for (std::size_t j = 0; j < recording_.joints.size(); ++j)
      for (std::size_t c = 0; c < recording_.channels.size(); ++c)
        headers_.push_back(fmt::format("{}.{}", recording_.joints[j],
                                       column_name(recording_.channels[c].name, recording_.units[j][c])));
  }
  const std::vector<std::string>& headers() const override { return headers_; }

 private:
  Result<std::vector<double>> column(std::size_t header) override {
    if (header == 0) return recording_.time_s;
    const std::size_t channels = recording_.channels.size();
    return recording_.values[(header - 1) / channels][(header - 1) % channels];
  }

  Recording recording_;
  std::vector<std::string> headers_;
};

}  // namespace

Opened open_record(const std::filesystem::path& file) {
  auto recording = read_telemetry(file);
  if (!recording) return tl::unexpected(recording.error());
  return std::make_unique<RecordSource>(std::move(*recording));
}

}  // namespace tribotwin::twin::tables
