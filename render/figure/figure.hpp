#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <tribotwin/plugins/friction/error.hpp>

/// A figure as values: what is drawn, not how. Texts may hold anything and are shown as they are, long titles
/// and labels with their middle left out; only Axis::symbol is markup of ours (gnuplot's enhanced text).
namespace tribotwin::render {

/// Labelled "quantity symbol [unit]"; without unit "-", without brackets where it is empty.
struct Axis {
  std::string quantity, symbol{}, unit{"-"};
  std::optional<double> from{}, to{};  ///< else around the values
  bool whole = false;                  ///< counts: no marks between whole numbers
};

enum class Mark {
  line,        ///< a point where a value has a gap on both sides
  reference,   ///< a thin dashed line, to compare with
  points,      ///< small and translucent where they are many
  error_bars,  ///< points with y +- error
  bars,        ///< from 0 to y, centred on evenly spaced x
  area,        ///< closed outline, lightly filled
  band         ///< the same without outline, for the uncertainty of a line
};

/// Of Mark::points; circle and cross are larger, so that shapes differ without colour, and so is disc, for few points
/// whose colour matters.
enum class Shape { dot, circle, cross, disc };

/// x, y (and error) of equal length. NaN leaves a gap; a series needs at least one finite point.
struct Series {
  Mark mark = Mark::line;
  std::string label{};  ///< in the key; none if empty
  std::vector<double> x{}, y{}, error{};
  std::vector<double> shade{};  ///< value on the figure's colour axis: none, one for all, or one per point
  Shape shape = Shape::dot;
  std::optional<std::size_t> stroke{};  ///< of theme::stroke; else counted up over the series with a label
};

/// The stroke of the next series of a figure; `counted` goes on over those with a label and none of their own.
inline std::size_t stroke_of(const Series& s, std::size_t& counted) {
  return s.stroke ? *s.stroke : s.label.empty() ? counted : counted++;
}

/// z over a grid: z[row of y][column of x]; coloured by z.
struct Surface {
  std::vector<double> x, y;
  std::vector<std::vector<double>> z;
};

/// Numbers between pairs of names, -1 to 1, symmetric: the lower half is drawn, the numbers in the cells. NaN is a
/// dash.
struct Matrix {
  std::vector<std::string> names;
  std::vector<std::vector<double>> values;
};

/// Numbers over two lists of names, the first row on top: cells coloured by the figure's colour axis, from white to
/// orange, so that ink is readable on all. NaN is grey.
struct HeatMap {
  std::vector<std::string> columns, rows;
  std::vector<std::vector<double>> values;           ///< values[row][column]
  bool numbers = true;                               ///< in the cells, where there is room
  int decimals = 2;                                  ///< of these
  std::vector<std::array<std::size_t, 2>> marked{};  ///< row and column of cells with a frame
  bool signed_values = false;                        ///< from blue over white at 0 to orange; the axis is symmetric
};

/// Horizontal bars from 0, one group per name, the first on top, each with its interval. NaN draws nothing.
struct Ranking {
  std::vector<std::string> names;
  struct Bars {
    std::string label;
    std::vector<double> values, low, high;  ///< low and high: NaN without interval
  };
  std::vector<Bars> bars;
};

struct Figure {
  std::string title;
  Axis x, y;
  std::optional<Axis> z{};       ///< with a surface
  std::optional<Axis> colour{};  ///< draws a colour bar; from and to are required
  std::vector<Series> series{};
  std::optional<Surface> surface{};
  std::optional<Matrix> matrix{};
  std::optional<HeatMap> heat_map{};  ///< needs `colour`
  std::optional<Ranking> ranking{};   ///< along x
  bool same_scale = false;            ///< one unit is as long on x as on y
};

enum class Format { svg, png, pdf };
/// By a file's ending. Fails on another ending and names these.
Result<Format> format_of(std::string_view file);

struct FigureSize {
  int width = 640, height = 430;
};  ///< [1/96 inch]; PNGs have twice the pixels

/// The file's bytes, drawn by gnuplot. Fails (ErrorKind::work) on series without a finite value, of unequal lengths or
/// with infinities, naming figure and series, and where gnuplot is missing or fails.
Result<std::string> draw(const Figure& figure, Format format, FigureSize size = {});

}  // namespace tribotwin::render
