#include <cmath>
#include <span>
#include <string>
#include <vector>

#include <fmt/format.h>

#include <tribotwin/twin/identification/matrix_input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::identification {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

MatrixXd read_matrix(Mapping& in, const std::string& key, Index rows, Index columns) {
  const YAML::Node node = in.raw(key);
  const auto wrong = [&] { in.fail(key, fmt::format("must be {} list(s) of {} finite numbers", rows, columns)); };
  MatrixXd out(rows, columns);
  if (!node || !node.IsSequence() || static_cast<Index>(node.size()) != rows) wrong();
  for (Index i = 0; i < rows; ++i) {
    const YAML::Node row = node[static_cast<std::size_t>(i)];
    if (!row.IsSequence() || static_cast<Index>(row.size()) != columns) wrong();
    for (Index k = 0; k < columns; ++k) {
      const YAML::Node cell = row[static_cast<std::size_t>(k)];
      if (!cell.IsScalar() || !YAML::convert<double>::decode(cell, out(i, k)) || !std::isfinite(out(i, k))) wrong();
    }
  }
  return out;
}

std::string yaml_of(const MatrixXd& matrix) {
  std::vector<std::string> rows;
  for (Index i = 0; i < matrix.rows(); ++i) {
    const VectorXd row = matrix.row(i);
    rows.push_back(fmt::format("[{}]", joined(std::span(row.data(), static_cast<std::size_t>(row.size())))));
  }
  return fmt::format("[{}]", joined(rows));
}

}  // namespace tribotwin::twin::identification
