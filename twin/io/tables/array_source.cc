#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include <tribotwin/twin/io/tables/source.hpp>

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

std::vector<Stripe> stripes_of(const Matrix& m, bool by_column, char open, char close, std::size_t first) {
  constexpr std::size_t most = 1024;
  // A vector, lying or standing, is one column.
  if (m.rows == 1 || m.columns == 1) return {{m.name, 0, 1, m.rows * m.columns}};
  std::vector<Stripe> out;
  for (std::size_t k = 0; k < m.columns && m.columns <= most; ++k)
    out.push_back({fmt::format("{}{}:,{}{}", m.name, open, k + first, close), by_column ? k * m.rows : k,
                   by_column ? 1 : m.columns, m.rows});
  constexpr std::size_t most_rows = 64;
  for (std::size_t k = 0; k < m.rows && m.rows <= most_rows; ++k)
    out.push_back({fmt::format("{}{}{},:{}", m.name, open, k + first, close), by_column ? k : k * m.columns,
                   by_column ? m.rows : 1, m.columns});
  return out;
}

}  // namespace tribotwin::twin::tables
