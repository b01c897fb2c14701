#include <algorithm>
#include <bit>
#include <cstdint>
#include <optional>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/tables/column.hpp>
#include <tribotwin/twin/io/tables/numpy_header.hpp>

namespace tribotwin::twin::tables {
namespace {

/// A Python literal of the few kinds that headers hold.
struct Literal {
  enum Kind { none, text, number, truth, list, mapping } kind = none;
  std::string word;
  std::uint64_t value = 0;
  std::vector<Literal> items;  ///< of a list or tuple; of a mapping keys and values in turn
};

class LiteralReader {
 public:
  explicit LiteralReader(std::string_view text) : rest_(text) {}

  std::optional<Literal> whole() {
    auto value = read(0);
    skip_blanks();
    return value && rest_.empty() ? value : std::nullopt;
  }

 private:
  void skip_blanks() {
    while (!rest_.empty() && (rest_[0] == ' ' || rest_[0] == '\n')) rest_.remove_prefix(1);
  }
  bool take(char c) {
    skip_blanks();
    if (rest_.empty() || rest_[0] != c) return false;
    rest_.remove_prefix(1);
    return true;
  }

  std::optional<Literal> read(int depth) {
    skip_blanks();
    if (rest_.empty() || depth > 8) return std::nullopt;
    const char c = rest_[0];
    if (c == '\'' || c == '"') return read_text(c);
    if (c == '(' || c == '[') return read_items(c == '(' ? ')' : ']', Literal::list, depth);
    if (c == '{') return read_items('}', Literal::mapping, depth);
    const auto end = std::min(rest_.find_first_of(" ,)]}:\n"), rest_.size());
    std::string_view word = rest_.substr(0, end);
    rest_.remove_prefix(end);
    if (word == "True" || word == "False")
      return Literal{.kind = Literal::truth, .word = {}, .value = word == "True", .items = {}};
    if (word.ends_with('L')) word.remove_suffix(1);  // of Python 2
    const auto value = to_integer<std::uint64_t>(word);
    if (!value) return std::nullopt;
    return Literal{.kind = Literal::number, .word = {}, .value = *value, .items = {}};
  }

  std::optional<Literal> read_text(char quote) {
    const auto end = rest_.find(quote, 1);
    if (end == rest_.npos) return std::nullopt;
    Literal out{.kind = Literal::text, .word = std::string(rest_.substr(1, end - 1)), .value = 0, .items = {}};
    rest_.remove_prefix(end + 1);
    if (out.word.find('\\') != std::string::npos) return std::nullopt;
    return out;
  }

  std::optional<Literal> read_items(char close, Literal::Kind kind, int depth) {
    rest_.remove_prefix(1);
    Literal out{.kind = kind, .word = {}, .value = 0, .items = {}};
    while (!take(close)) {
      auto item = read(depth + 1);
      if (!item) return std::nullopt;
      out.items.push_back(std::move(*item));
      if (kind == Literal::mapping) {
        if (!take(':')) return std::nullopt;
        auto value = read(depth + 1);
        if (!value) return std::nullopt;
        out.items.push_back(std::move(*value));
      }
      if (!take(',')) {
        if (take(close)) break;
        return std::nullopt;
      }
    }
    return out;
  }

  std::string_view rest_;
};

/// "<f8" as a field.
std::optional<NumpyField> field_of(std::string_view type) {
  if (type.empty()) return std::nullopt;
  NumpyField field;
  constexpr bool little = std::endian::native == std::endian::little;
  if (type[0] == '<' || type[0] == '>' || type[0] == '|' || type[0] == '=') {
    field.swapped = type[0] == (little ? '>' : '<');
    type.remove_prefix(1);
  }
  if (type.empty()) return std::nullopt;
  field.kind = type[0];
  std::string_view digits = type.substr(1);
  if (field.kind == 'm' || field.kind == 'M') digits = digits.substr(0, digits.find('['));
  if (field.kind == 'O' && digits.empty()) return field;
  const auto size = to_integer<std::uint32_t>(digits);
  if (!size || *size > (1u << 24)) return std::nullopt;
  field.size = field.kind == 'U' ? std::size_t{4} * *size : *size;
  return field;
}

/// The fields of 'descr': a type, or a list of (name, type[, shape]).
std::optional<std::string> read_fields(const Literal& descr, NumpyHeader& out) {
  const auto wrong = [](std::string_view type) { return fmt::format("its type {} is not understood", shown(type)); };
  if (descr.kind == Literal::text) {
    const auto field = field_of(descr.word);
    if (!field) return wrong(descr.word);
    out.fields = {*field};
    out.item_bytes = field->size;
    return std::nullopt;
  }
  if (descr.kind != Literal::list || descr.items.empty() || descr.items.size() > 10000) return wrong("descr");
  for (const Literal& entry : descr.items) {
    if (entry.kind != Literal::list || entry.items.size() < 2 || entry.items.size() > 3 ||
        entry.items[1].kind != Literal::text)
      return std::string("one of its fields has fields itself, or no type");
    auto field = field_of(entry.items[1].word);
    if (!field) return wrong(entry.items[1].word);
    field->name = entry.items[0].word;
    field->offset = out.item_bytes;
    if (entry.items.size() == 3) {
      const Literal& shape = entry.items[2];
      for (const Literal& n : shape.items)
        if (n.kind != Literal::number || n.value > 100000 || (field->count *= n.value) > 100000)
          return fmt::format("the shape of its field {} is not understood", shown(field->name));
      if (shape.kind == Literal::number) field->count = std::min<std::uint64_t>(shape.value, 100000);
    }
    out.item_bytes += field->size * field->count;
    if (field->kind != 'V' && field->count > 0) out.fields.push_back(std::move(*field));  // V: padding
  }
  return std::nullopt;
}

std::optional<std::string> read_shape(const Literal& shape, NumpyHeader& out) {
  if (shape.kind != Literal::list || shape.items.size() > 32) return "its shape is not understood";
  for (const Literal& n : shape.items) {
    if (n.kind != Literal::number) return "its shape is not understood";
    out.shape.push_back(n.value);
  }
  return std::nullopt;
}

}  // namespace

bool NumpyField::number() const {
  const bool power = size == 1 || size == 2 || size == 4 || size == 8;
  return (kind == 'f' && (size == 4 || size == 8)) || ((kind == 'i' || kind == 'u') && power) ||
         (kind == 'b' && size == 1);
}

Result<NumpyHeader> read_numpy_header(const std::function<std::size_t(char*, std::size_t)>& read) {
  unsigned char start[12] = {};
  const auto fail = [](const std::string& why) { return tl::unexpected(Error(why)); };
  const auto get = [&](unsigned char* to, std::size_t count) {
    return read(reinterpret_cast<char*>(to), count) == count;
  };
  if (!get(start, 8) || std::string_view(reinterpret_cast<char*>(start), 6) != "\x93NUMPY")
    return fail("is no NumPy array");
  const int version = start[6];
  if (version < 1 || version > 3) return fail(fmt::format("is of NumPy format {}; 1 to 3 are read", version));
  const std::size_t length_bytes = version == 1 ? 2 : 4;
  if (!get(start + 8, length_bytes)) return fail("is cut off in its header");
  std::size_t length = 0;
  for (std::size_t i = 0; i < length_bytes; ++i) length |= std::size_t{start[8 + i]} << (8 * i);
  if (length > limits::numpy_header_bytes)
    return fail(fmt::format("has a header of {} bytes; at most {} are read", length, limits::numpy_header_bytes));
  std::string text(length, '\0');
  if (read(text.data(), length) != length) return fail("is cut off in its header");
  const auto literal = LiteralReader(text).whole();
  if (!literal || literal->kind != Literal::mapping)
    return fail(fmt::format("has a header that is not understood: {}", shown(text)));
  NumpyHeader out{.fields = {}, .shape = {}, .header_bytes = 8 + length_bytes + length};
  int known = 0;
  for (std::size_t i = 0; i + 1 < literal->items.size(); i += 2) {
    const std::string& key = literal->items[i].word;
    const Literal& value = literal->items[i + 1];
    std::optional<std::string> problem;
    if (key == "descr") problem = read_fields(value, out);
    if (key == "shape") problem = read_shape(value, out);
    if (key == "fortran_order") out.fortran_order = value.value != 0;
    known += key == "descr" || key == "shape" || key == "fortran_order";
    if (problem) return fail(*problem);
  }
  if (known != 3) return fail("has a header without descr, shape and fortran_order");
  return out;
}

}  // namespace tribotwin::twin::tables
