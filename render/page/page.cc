#include <algorithm>
#include <regex>
#include <sstream>

#include <fmt/format.h>
#include <gio/gio.h>

#include <tribotwin/render/page/in_words.hpp>
#include <tribotwin/render/page/page.hpp>
#include <tribotwin/render/page/script.hpp>
#include <tribotwin/render/theme/theme.hpp>

namespace tribotwin::render {
namespace {

/// Custom properties --s0, --s1, ... of the strokes.
std::string stroke_properties(Colour theme::Stroke::*colour) {
  std::string css;
  for (std::size_t i = 0; i < theme::strokes; ++i) css += fmt::format("--s{}: {}; ", i, hex(theme::stroke(i).*colour));
  return css;
}

/// gnuplot's drawings on a dark page: the colours of the theme, which are attributes there, are exchanged.
std::string dark_drawings() {
  std::string css = fmt::format("  svg.drawn:not(.inverts) {{ background: {}; }}\n", hex(theme::dark::paper));
  const auto exchange = [&](Colour light, Colour dark) {
    for (const auto& name : {fmt::format("rgb({:3}, {:3}, {:3})", light.r, light.g, light.b),
                             fmt::format("rgb({},{},{})", light.r, light.g, light.b), hex(light)})
      for (const char* attribute : {"fill", "stroke", "color"})
        css += fmt::format("  .drawn:not(.inverts) [{0}=\"{1}\" i] {{ {0}: {2}; }}\n", attribute, name, hex(dark));
  };
  exchange(theme::paper, theme::dark::paper);
  exchange(theme::ink, theme::dark::ink);
  exchange(theme::ink_soft, theme::dark::ink_soft);
  exchange(theme::line, theme::dark::line);
  for (std::size_t i = 0; i < theme::strokes; ++i) exchange(theme::stroke(i).colour, theme::stroke(i).on_dark);
  return css;
}

/// Below this width a table of this class becomes a list of rows, each value with its head beside it.
std::string list_of_rows(std::string_view table, int width_px) {
  std::string css = R"(@media screen and (max-width: WIDTHpx) {
  table.X thead { display: none; }
  table.X, table.X tbody, table.X tr, table.X th, table.X td { display: block; }
  table.X tr { border-top: 1px solid LINE; padding: 6px 0; }
  table.X th, table.X td, table.X td.number { border-top: 0; max-width: none; padding: 2px 10px; text-align: left;
    white-space: normal; word-break: keep-all; }
  table.X td { display: flex; justify-content: space-between; gap: 1em; overflow-wrap: anywhere; }
  table.X td::before { content: attr(data-label); color: SOFT; max-width: 60%; overflow-wrap: break-word; }
}
)";
  const auto put = [&](std::string_view name, std::string_view value) {
    for (std::size_t at; (at = css.find(name)) != std::string::npos;) css.replace(at, name.size(), value);
  };
  put(".X", fmt::format(".{}", table));
  put("WIDTH", fmt::format("{}", width_px));
  return css;
}

// Without characters that XML escapes: browsers take the content of <style> as it is.
std::string style() {
  std::string css = R"(
* { box-sizing: border-box; }
body { margin: 0; background: PAGE; color: INK; font: 16px/1.5 FONT; }
main { max-width: 1240px; margin: 0 auto; padding: 32px 24px 48px; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .3rem; overflow-wrap: anywhere; }
h2 { font-size: 1.35rem; margin: 2.6rem 0 .2rem; overflow-wrap: anywhere; }
h3 { font-size: 1.05rem; margin: 1.8rem 0 .6rem; overflow-wrap: anywhere; }
.verdict { text-wrap: balance; font-size: 1.2rem; max-width: 68ch; }
#verdict { font-size: 1.3rem; font-weight: 600; line-height: 1.35; margin: .5rem 0; }
.identity { margin: 0; }
.lamp::before { content: ""; display: inline-block; width: .8em; height: .8em; border-radius: 50%; margin-right: .45em;
  background: currentColor; vertical-align: -.05em; print-color-adjust: exact; }
details { margin: 1rem 0; }
summary { cursor: pointer; font-weight: 600; color: SOFT; padding: .2rem 0; overflow-wrap: anywhere; }
p { margin: .3rem 0 .8rem; overflow-wrap: anywhere; max-width: 75ch; }
.soft { color: SOFT; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 165px), 1fr)); gap: 14px;
  margin: 1.2rem 0; }
.tile, figure, .notice, .scroll, pre { background: PAPER; border: 1px solid LINE; border-radius: 10px; }
.tile { padding: 12px 16px; }
.tile .name, .tile .more { color: SOFT; font-size: .88rem; overflow-wrap: anywhere; }
.tile .value { font-size: 1.3rem; font-weight: 650; overflow-wrap: anywhere; }
.good { color: GOOD; }
.warn { color: WARN; }
.bad { color: BAD; }
.notice { border-left: 5px solid BAD; padding: 10px 16px; margin: 1rem 0; }
.notice p { margin: .2rem 0; }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr)); gap: 16px;
  margin: 1rem 0; }
figure { margin: 0; padding: 12px; min-width: 0; }
figure.wide, figure:last-child:nth-child(odd) { grid-column: 1 / -1; }
figure svg { max-width: 660px; margin: 0 auto; }
figure.wide svg { max-width: 880px; }
.figures.many { grid-template-columns: repeat(auto-fill, minmax(min(100%, 250px), 1fr)); }
figure.small:last-child:nth-child(odd) { grid-column: auto; }
figure svg { background: PAPER; }
figure svg, figure img { display: block; width: 100%; height: auto; border-radius: 5px; }
figure svg text, figure svg tspan { font-family: FONT; }
figcaption { color: SOFT; font-size: .9rem; margin-top: 8px; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { padding: 7px 14px; text-align: left; border-top: 1px solid LINE; vertical-align: top; }
thead th, thead th.number { border-top: 0; color: SOFT; font-weight: 600; vertical-align: bottom; white-space: normal; }
td:last-child:not(.number) { min-width: 20ch; }
td.number, th.number { text-align: right; white-space: nowrap; }
table.wide td.number { white-space: normal; }
td.whole, table.wide td.whole { white-space: nowrap; }
table.wide th, table.wide td { padding: 6px 8px; }
table.wide td:last-child:not(.number) { min-width: 0; }
th[scope=row] { font-weight: 600; overflow-wrap: break-word; max-width: 32ch; }
pre { padding: 12px 16px; font: .88rem/1.5 ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace;
  white-space: pre-wrap; overflow-wrap: anywhere; }
@media (max-width: 1200px) { th, td { padding: 6px 8px; } }
@media (max-width: 600px) {
  main { padding: 18px 12px 32px; }
  th, td { padding: 6px 8px; }
  td.number, th.number { white-space: normal; }
  td:last-child:not(.number) { min-width: 0; }
}
NARROW
.live { display: none; }
.alive .live { display: block; }
.alive .live.head { display: flex; justify-content: space-between; align-items: center; gap: 8px; }
.alive .drawn { display: none; }
.live.area { position: relative; }
figure .live svg { max-width: none; background: none; }
svg.live { touch-action: pan-y; user-select: none; }
svg.live text { fill: INK; font-size: 12px; }
svg.live .middle { text-anchor: middle; }
svg.live .end { text-anchor: end; }
svg.live .italic { font-style: italic; }
svg.live .sub { font-size: 9px; }
svg.live .grid { stroke: LINE; fill: none; }
svg.live .axis { stroke: SOFT; fill: none; }
svg.live .cursor { stroke: INK; fill: none; pointer-events: none; }
svg.live .chosen { fill: SOFT; fill-opacity: .2; }
.series { fill: none; stroke-linejoin: bevel; }
.alive .live.sliders { display: flex; flex-wrap: wrap; gap: 4px 24px; margin: 6px 0; }
.alive p.live { font-size: .92rem; margin: .4rem 0; max-width: none; }
.sliders label { display: flex; flex: 1 1 300px; min-width: 0; align-items: center; gap: 8px; font-size: .92rem; }
.sliders input { flex: 1; min-width: 60px; accent-color: var(--s0); }
.robot canvas { display: block; width: 100%; height: min(62vw, 560px); border-radius: 5px; cursor: grab;
  touch-action: pan-y; }
.robot canvas:focus { touch-action: none; }
.robot canvas:active { cursor: grabbing; }
.robot .bar { font-size: .9rem; }
.robot .strip { height: 12px; border-radius: 3px; margin: 0 1.2rem; }
.robot .marks { position: relative; height: 1.4em; font-size: .82rem; }
.robot .marks span { position: absolute; left: calc(1.2rem + (100% - 2.4rem) * var(--at));
  transform: translateX(-50%); }
.sliders output { min-width: 8ch; white-space: nowrap; text-align: right; font-variant-numeric: tabular-nums; }
.head strong { min-width: 0; overflow-wrap: anywhere; }
.tools { white-space: nowrap; }
.live button { font: inherit; font-size: .82rem; color: INK; background: none; border: 1px solid LINE;
  border-radius: 6px; padding: 1px 8px; margin: 2px 4px 2px 0; cursor: pointer; max-width: 100%;
  overflow-wrap: anywhere; }
.live button[aria-pressed=false] { text-decoration: line-through; color: SOFT; }
.key .sample { display: inline-block; width: 26px; height: 10px; margin: 0 6px 0 0; vertical-align: 0; }
.tip { position: absolute; pointer-events: none; background: PAPER; border: 1px solid LINE; border-radius: 6px;
  padding: 3px 8px; font-size: .8rem; line-height: 1.35; max-width: 80%; z-index: 1; }
.tip i { display: inline-block; width: .7em; height: .7em; margin-right: .4em; }
.tip[hidden] { display: none; }
th[title] { cursor: pointer; }
th[aria-sort=ascending]::after { content: " \25b4"; }
th[aria-sort=descending]::after { content: " \25be"; }
:root { STROKES }
@media screen and (prefers-color-scheme: dark) {
  :root { DARKSTROKES }
  body { background: #12161c; color: #e6eaf0; color-scheme: dark; }
  .tile, figure, .notice, .scroll, pre, .tip { background: #1b212a; border-color: #3a4452; }
  .live button { color: #e6eaf0; border-color: #3a4452; }
  .soft, .tile .name, .tile .more, figcaption, thead th, thead th.number, summary { color: #b3bdca; }
  .live button[aria-pressed=false] { color: #b3bdca; }
  th, td, table.many tr { border-color: #3a4452; }
  table.many td::before { color: #b3bdca; }
  .good { color: #6fd39a; }
  .warn { color: #f0c060; }
  .bad { color: #ff9a90; }
  .notice { border-left-color: #ff9a90; }
  svg.live text { fill: #e6eaf0; }
  svg.live .grid { stroke: #3a4452; }
  svg.live .axis { stroke: #b3bdca; }
  svg.live .cursor { stroke: #e6eaf0; }
  .drawn.inverts { filter: invert(.88) hue-rotate(180deg); }
DRAWN
}
@media print {
  .alive .live, .alive .live.head, .alive .live.sliders { display: none; }
  .alive .drawn { display: block; }
  .robot { display: none; }
  @page { margin: 11mm; }
  body { background: PAPER; font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  details:not([open]) { margin: .2rem 0; break-inside: avoid; }
  details:not([open]) summary::after { content: ' (closed, so not printed) '; font-weight: 400; }
  h2 { margin-top: 1.4rem; }
  h3 { margin-top: 1rem; }
  .tiles { grid-template-columns: repeat(5, 1fr); gap: 8px; }
  .tile { padding: 6px 8px; }
  .figures { gap: 8px; margin: .5rem 0; }
  figure { padding: 6px; }
  figure.wide img { max-height: 110mm; object-fit: contain; }
  .figures { grid-template-columns: 1fr 1fr; }
  .figures.many { grid-template-columns: repeat(3, minmax(0, 1fr)); }
  figure, .tile, tr, pre { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  .scroll { overflow: visible; }
  table { font-size: .85em; }
  th, td { padding: 4px 7px; }
  table.wide th, table.wide td { padding: 4px; }
  td:last-child:not(.number) { min-width: 12ch; }
}
)";
  const auto put = [&](std::string_view name, const std::string& value) {
    for (std::size_t at; (at = css.find(name)) != std::string::npos;) css.replace(at, name.size(), value);
  };
  put("NARROW", list_of_rows("many", 640) + list_of_rows("wide", 1000));
  put("DARKSTROKES", stroke_properties(&theme::Stroke::on_dark));
  put("STROKES", stroke_properties(&theme::Stroke::colour));
  put("DRAWN", dark_drawings());
  put("PAGE", hex(theme::page));
  put("PAPER", hex(theme::paper));
  put("INK", hex(theme::ink));
  put("SOFT", hex(theme::ink_soft));
  put("LINE", hex(theme::line));
  put("GOOD", hex(theme::good));
  put("WARN", hex(theme::warn));
  put("BAD", hex(theme::bad));
  put("FONT", std::string(theme::page_font));
  return css;
}

/// As content security policies name a script.
std::string sha256_base64(const std::string& text) {
  const std::unique_ptr<GChecksum, decltype(&g_checksum_free)> sum(g_checksum_new(G_CHECKSUM_SHA256), g_checksum_free);
  g_checksum_update(sum.get(), reinterpret_cast<const guchar*>(text.data()), static_cast<gssize>(text.size()));
  std::string digest(32, '\0');
  gsize size = digest.size();
  g_checksum_get_digest(sum.get(), reinterpret_cast<guint8*>(digest.data()), &size);
  return base64(digest);
}

/// gnuplot's drawings all use the same ids; in one page they must differ.
void prefix_ids(pugi::xml_node node, const std::string& prefix) {
  for (auto attribute : node.attributes()) {
    const std::string_view name = attribute.name();
    const std::string value = attribute.value();
    if (name == "id")
      attribute.set_value((prefix + value).c_str());
    else if (name == "xlink:href" && value.starts_with('#'))
      attribute.set_value(("#" + prefix + value.substr(1)).c_str());
    else if (const auto at = value.find("url(#"); at != std::string::npos)
      attribute.set_value((value.substr(0, at + 5) + prefix + value.substr(at + 5)).c_str());
  }
  for (auto child = node.first_child(); child;) {
    const auto next = child.next_sibling();
    const std::string_view name = child.name();
    if (name == "title" || name == "desc")
      node.remove_child(child);
    else
      prefix_ids(child, prefix);
    child = next;
  }
}

/// A table of more columns becomes a list of rows where the window is narrow.
constexpr std::size_t columns_of_a_phone = 2, columns_of_a_tablet = 4;
constexpr std::size_t longest_head = 20;  ///< in one piece

/// Numbers as programs write them, "8.4e-05", with a typeset power; part of a name they stay. A pattern repeats at most
/// 40 times, here and below: std::regex takes stack for each, and digits may be as many as somebody's file has.
std::string with_typeset_powers(const std::string& text) {
  static const std::regex number(R"((^|[^\w.])(\d[\d.]{0,40})e([-+]\d\d\d?)(?=$|[ ,;)…\n]|\. |\.$))");
  std::string out;
  auto rest = text.begin();
  for (std::sregex_iterator found(text.begin(), text.end(), number), end; found != end; ++found) {
    out.append(rest, text.begin() + found->position());
    out += found->str(1) + found->str(2) + "·" + power_of_ten(std::stoi(found->str(3)));
    rest = text.begin() + found->position() + found->length();
  }
  return out.append(rest, text.end());
}

/// Ranges and deviations as programs write them, "1.2 .. 3.4" and "5 +- 0.3", with an en dash and a plus-minus sign.
std::string with_typeset_ranges(const std::string& text) {
  static const std::regex range(R"((\d[%)]?) ?\.\. ?(?=[-+]?\d))"), deviation(R"(\+- ?(?=\d))");
  return std::regex_replace(std::regex_replace(text, range, "$1 – "), deviation, "± ");
}

/// "joint1" of "joint joint1".
std::string without_doubled_joint(std::string text) {
  constexpr std::string_view doubled = "joint joint", once = "joint";
  for (std::size_t at = 0; (at = text.find(doubled, at)) != text.npos;) text.replace(at, doubled.size(), once);
  return text;
}

/// Whether a word is a unit or a percent sign, which does not begin a line after its number.
bool belongs_to_number(std::string_view word) {
  static constexpr std::string_view units[] = {"%",  "°C", "K",  "Nm",  "N",  "W",   "kW",   "J", "kJ", "MJ",
                                               "GJ", "s",  "ms", "min", "h",  "rad", "mrad", "m", "mm", "kg",
                                               "A",  "V",  "Hz", "kHz", "kB", "MB",  "×",    "–", "±"};
  return std::ranges::find(units, word.substr(0, word.find('/'))) != std::end(units);
}

/// Whether text that ends so ends with a digit, also a raised one, or with a plus-minus sign.
bool ends_with_number(std::string_view text) {
  if (text.empty()) return false;
  if (g_ascii_isdigit(text.back()) || text.ends_with("±")) return true;
  return std::ranges::any_of(std::initializer_list<std::string_view>{"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"},
                             [&](std::string_view digit) { return text.ends_with(digit); });
}

/// With spaces that break no line between numbers and their units, and around the sign of a deviation.
std::string with_numbers_whole(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != ' ' || !ends_with_number(std::string_view(text.data(), i))) {
      out += text[i];
      continue;
    }
    const std::string_view before(text.data(), i), after(text.data() + i + 1, text.size() - i - 1);
    const auto word = after.substr(0, after.find_first_of(" ,;:.)\n"));
    const bool tied = belongs_to_number(word) || (before.ends_with("±") && !after.empty());
    out += tied ? "\u00a0" : " ";
  }
  return out;
}

/// Text of programs as readers know it: the word degC is °C, s^2 is s², 8.4e-05 is 8.4·10⁻⁵, 1 .. 2 is 1 – 2, 5 +- 1 is
/// 5 ± 1. Part of a name it stays.
std::string in_print(std::string text) {
  static const std::regex degrees(R"((^|\W)degC\b)");
  if (text.find("degC") != text.npos) text = std::regex_replace(text, degrees, "$1°C");
  text = without_doubled_joint(with_superscripts(std::move(text)));
  if (text.find("e-") != text.npos || text.find("e+") != text.npos) text = with_typeset_powers(text);
  if (text.find("..") != text.npos || text.find("+-") != text.npos) text = with_typeset_ranges(text);
  return with_numbers_whole(text);
}

/// The dots of a long dotted name, joints.hinge.temperature_degC.end say, are no ends of words.
std::string head_in_print(const std::string& text) {
  return text.size() > longest_head ? with_typeset_powers(with_superscripts(text)) : in_print(text);
}

/// A head with places where a long dotted name, joints.hinge.temperature_degC.end say, may go on in the next line.
pugi::xml_node add_head(pugi::xml_node to, const std::string& name, const char* kind = nullptr) {
  auto head = Page::add(to, "th", name.size() > longest_head ? "" : name, kind);
  if (name.size() <= longest_head) return head;
  const std::string text = head_in_print(name);
  std::size_t from = 0;
  for (std::size_t i = 1; i + 1 < text.size(); ++i)
    if (text[i] == '.' && g_ascii_isalpha(text[i - 1]) && g_ascii_isalpha(text[i + 1])) {
      head.append_child(pugi::node_pcdata).set_value(printable(text.substr(from, i + 1 - from), true).c_str());
      head.append_child("wbr");
      from = i + 1;
    }
  head.append_child(pugi::node_pcdata).set_value(printable(text.substr(from), true).c_str());
  return head;
}

constexpr const char* no_scripts = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src";

const char* class_of(Width width) {
  switch (width) {
    case Width::normal:
      return nullptr;
    case Width::wide:
      return "wide";
    case Width::small:
      return "small";
  }
  return nullptr;
}

/// What says nothing about what a column holds.
bool says_nothing(std::string_view cell) { return cell.empty() || cell == "–" || cell == "*" || cell == "none"; }

/// "-0.3", "+13.6 %", "± 4.4 %", "> 99 %", "less than 0.1 %"; "1/K" and "6620-104417" are none.
bool numeric(std::string_view cell) {
  static const std::regex number(R"((± ?|[<>] ?|less than )?[-+]?\d[\d.]{0,40}(?![-/\d.])|\d{4}-\d\d-\d\d)");
  return std::regex_search(cell.begin(), cell.end(), number, std::regex_constants::match_continuous);
}

/// Whether at least half of what a column says are numbers.
bool holds_numbers(const std::vector<std::vector<std::string>>& rows, std::size_t column) {
  std::size_t numbers = 0, words = 0;
  for (const auto& row : rows)
    if (column < row.size() && !says_nothing(row[column])) ++(numeric(row[column]) ? numbers : words);
  return numbers > 0 && numbers >= words;
}

/// Whether a cell stays on one line: "2026-03-15", and, where a table has not many columns, "+13.6 %" and "1.47 MJ".
bool stays_whole(std::string_view cell, std::size_t columns) {
  constexpr std::size_t longest = 10, many_columns = 8;
  if (cell.starts_with("± ")) cell.remove_prefix(std::string_view("± ").size());
  const auto blank = cell.find(' ');
  const bool one_unit = blank != cell.npos && cell.find(' ', blank + 1) == cell.npos && cell.size() - blank <= 4;
  const bool date = cell.size() == 10 && cell[4] == '-' && cell[7] == '-';
  return cell.size() <= longest && numeric(cell) && (date || (one_unit && columns <= many_columns));
}

}  // namespace

std::string base64(std::string_view bytes) {
  const std::unique_ptr<char, decltype(&g_free)> text(
      g_base64_encode(reinterpret_cast<const guchar*>(bytes.data()), bytes.size()), g_free);
  return text.get();
}

std::string deflated(std::string_view bytes) {
  const std::unique_ptr<GZlibCompressor, decltype(&g_object_unref)> zlib(
      g_zlib_compressor_new(G_ZLIB_COMPRESSOR_FORMAT_ZLIB, 9), g_object_unref);
  std::string packed(bytes.size() + bytes.size() / 1000 + 64, '\0');  // zlib makes nothing longer than that
  gsize read = 0, written = 0;
  g_converter_convert(G_CONVERTER(zlib.get()), bytes.data(), bytes.size(), packed.data(), packed.size(),
                      G_CONVERTER_INPUT_AT_END, &read, &written, nullptr);
  packed.resize(written);
  return packed;
}

std::string without_folders(const std::string& text) {
  static constexpr std::string_view ends = " \t\n\r'\"`";
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const bool begins = text[at] == '/' && (at == 0 || ends.find(text[at - 1]) != ends.npos);
    const std::size_t end = begins ? std::min(text.find_first_of(ends, at), text.size()) : at;
    if (end < at + 2) {  // a sign of division is no path
      out += text[at++];
      continue;
    }
    const std::string path = text.substr(at, end - at);
    const auto shipped = path.rfind("/mjcf/"), slash = path.rfind('/');
    out += shipped != path.npos ? path.substr(shipped + 1) : path.substr(slash + 1);
    at = end;
  }
  return out;
}

pugi::xml_node Page::add(pugi::xml_node to, const char* tag, std::string_view text, const char* kind) {
  auto node = to.append_child(tag);
  if (kind) node.append_attribute("class") = kind;
  if (text.empty()) return node;
  const std::string shown = printable(text, true);
  node.text() = (std::string_view(tag) == "pre" ? shown : in_print(shown)).c_str();
  return node;
}

pugi::xml_node Page::add_named(pugi::xml_node to, std::string_view name, std::string_view text, const char* kind) {
  auto paragraph = add(to, "p", text);
  auto strong = paragraph.prepend_child("strong");
  if (kind) strong.append_attribute("class") = kind;
  strong.text() = printable(name).c_str();
  return paragraph;
}

Page::Page(std::string_view title) {
  document_.append_child(pugi::node_doctype).set_value("html");
  auto html = document_.append_child("html");
  html.append_attribute("lang") = "en";
  auto head = html.append_child("head");
  head.append_child("meta").append_attribute("charset") = "utf-8";
  const auto meta = [&](const char* key, const char* name, const char* content) {
    auto node = head.append_child("meta");
    node.append_attribute(key) = name;
    node.append_attribute("content") = content;
  };
  meta("http-equiv", "Content-Security-Policy", no_scripts);
  policy_ = head.last_child();
  meta("name", "viewport", "width=device-width, initial-scale=1");
  meta("name", "generator", "tribotwin-report");
  head.append_child("title").text() = printable(title).c_str();
  head.append_child("link").append_attribute("rel") = "icon";
  head.child("link").append_attribute("href") = "data:,";
  head.append_child("style").text() = style().c_str();
  main_ = html.append_child("body").append_child("main");
}

void Page::add_svg(pugi::xml_node to, const Svg& svg, const std::string& caption, const std::string& alternative,
                   Width width) {
  pugi::xml_document drawing;
  auto figure = add(to, "figure", {}, class_of(width));
  if (drawing.load_buffer(svg.markup.data(), svg.markup.size(), pugi::parse_default | pugi::parse_ws_pcdata_single)) {
    auto root = figure.append_copy(drawing.document_element());
    root.remove_attribute("width");
    root.remove_attribute("height");
    root.append_attribute("class") = svg.inverts ? "drawn inverts" : "drawn";
    root.append_attribute("role") = "img";
    root.append_attribute("aria-label") = printable(alternative).c_str();
    prefix_ids(root, fmt::format("f{}-", ++figures_));
    if (!svg.data.empty()) figure.append_attribute("data-figure") = std::string(svg.data).c_str();
  }
  add(figure, "figcaption", caption);
}

void Page::add_png(pugi::xml_node to, std::string_view png, const std::string& caption, const std::string& alternative,
                   Width width) {
  auto figure = add(to, "figure", {}, class_of(width));
  auto image = figure.append_child("img");
  image.append_attribute("alt") = printable(alternative).c_str();
  image.append_attribute("src") = ("data:image/png;base64," + base64(png)).c_str();
  add(figure, "figcaption", caption);
}

pugi::xml_node Page::add_details(pugi::xml_node to, const std::string& summary) {
  auto details = add(to, "details");
  add(details, "summary", summary);
  return details;
}

void Page::add_table(pugi::xml_node to, const std::vector<std::string>& head,
                     const std::vector<std::vector<std::string>>& rows) {
  auto scroll = add(to, "div", {}, "scroll");
  scroll.append_attribute("tabindex") = "0";
  auto table = scroll.append_child("table");
  const bool many = head.size() > columns_of_a_phone;
  if (many) table.append_attribute("class") = head.size() > columns_of_a_tablet ? "many wide" : "many";
  const auto kind = [&](std::size_t column) {
    return column > 0 && !head.empty() && holds_numbers(rows, column) ? "number" : nullptr;
  };
  if (!head.empty()) {
    auto line = table.append_child("thead").append_child("tr");
    for (std::size_t i = 0; i < head.size(); ++i) add_head(line, head[i], kind(i)).append_attribute("scope") = "col";
  }
  auto body = table.append_child("tbody");
  for (const auto& row : rows) {
    auto line = body.append_child("tr");
    for (std::size_t i = 0; i < row.size(); ++i)
      if (i == 0) {
        add_head(line, row[i]).append_attribute("scope") = "row";
      } else {
        std::string of = kind(i) ? kind(i) : "";
        if (stays_whole(row[i], row.size())) of += of.empty() ? "whole" : " whole";
        auto cell = add(line, "td", row[i].empty() ? "–" : row[i], of.empty() ? nullptr : of.c_str());
        if (many) cell.append_attribute("data-label") = printable(head_in_print(head[i])).c_str();
      }
  }
}

void Page::allow(const std::string& source) {
  if (std::ranges::find(allowed_, source) == allowed_.end()) allowed_.push_back(source);
}

void Page::allow_kernel() { allow("'wasm-unsafe-eval'"); }

void Page::add_robot(pugi::xml_node to, const std::string& packed, const std::string& caption) {
  auto figure = add(to, "figure", {}, "robot");
  figure.append_attribute("hidden") = "";
  figure.append_attribute("data-robot") = base64(packed).c_str();
  add(figure, "figcaption", caption);
  auto body = main_.parent();
  if (body.find_child_by_attribute("class", "library")) return;
  const std::string_view library = twin::live::page_file("/three.min.js")->content;
  allow("'sha256-" + sha256_base64(std::string(library)) + "'");
  auto box = add(body, "div", {}, "library");
  box.append_attribute("hidden") = "";
  box.append_attribute("data-licence") = std::string(twin::live::page_file("/three.licence.txt")->content).c_str();
  box.append_attribute("data-three") = base64(deflated(library)).c_str();
}

std::string Page::html() const {
  // Of scripts only this one runs: whatever else gets into the page is not what was hashed.
  const std::string own = script(bool(main_.parent().find_child_by_attribute("class", "library")));
  std::string policy = fmt::format("{} 'sha256-{}'", no_scripts, sha256_base64(own));
  for (const auto& source : allowed_) policy += " " + source;
  auto content = policy_.attribute("content");
  content = policy.c_str();
  std::ostringstream out;
  document_.save(out, "", pugi::format_raw | pugi::format_no_declaration, pugi::encoding_utf8);
  // Put in as text: in a script, unlike elsewhere in XML, nothing is escaped.
  std::string page = out.str();
  page.insert(page.rfind("</body>"), "<script>" + own + "</script>");
  return page;
}

}  // namespace tribotwin::render
