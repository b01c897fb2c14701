#include <algorithm>
#include <bit>
#include <cstring>

#include <fmt/format.h>

#include <tribotwin/twin/io/mcap/joint_states.hpp>
#include <tribotwin/twin/io/mcap/joint_states_json.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::mcap {
namespace {

using Status = Result<void>;
constexpr std::int64_t ns_per_s = 1'000'000'000;

tl::unexpected<Error> wrong(std::string what) { return tl::unexpected(Error(std::move(what))); }

/// A serialised message, field by field. Beyond its end everything is zero or empty, and whole() is false from then on.
class Fields {
 public:
  struct Form {
    bool swapped;           ///< bytes of numbers are in the other order than this machine's
    std::size_t alignment;  ///< of a number: its size, at most this
    bool terminated;        ///< texts end with a NUL that counts
  };
  Fields(std::string_view bytes, Form form) : bytes_(bytes), form_(form) {}

  template <class T>
  T number() {
    const std::size_t step = std::min(sizeof(T), form_.alignment);
    at_ = (at_ + step - 1) / step * step;
    const auto raw = take(sizeof(T));
    T value{};
    if (!whole_) return value;
    char bytes[sizeof(T)];
    std::memcpy(bytes, raw.data(), sizeof bytes);
    if (form_.swapped) std::reverse(bytes, bytes + sizeof bytes);
    std::memcpy(&value, bytes, sizeof bytes);
    return value;
  }
  std::string_view text() {
    auto out = take(number<std::uint32_t>());
    if (form_.terminated && !out.empty()) out.remove_suffix(1);
    return out;
  }
  /// How many elements of at least `bytes` follow.
  std::uint32_t count(std::size_t bytes) {
    const auto n = number<std::uint32_t>();
    whole_ = whole_ && n <= (bytes_.size() - at_) / bytes;
    return whole_ ? n : 0;
  }
  bool whole() const { return whole_; }

 private:
  std::string_view take(std::size_t count) {
    whole_ = whole_ && at_ <= bytes_.size() && count <= bytes_.size() - at_;
    if (!whole_) return {};
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }

  std::string_view bytes_;
  Form form_;
  std::size_t at_ = 0;
  bool whole_ = true;
};

void read_header(Fields& in, bool ros1, JointNumbers& out) {
  if (ros1) (void)in.number<std::uint32_t>();  // seq
  const std::int64_t seconds = in.number<std::int32_t>();
  out.stamp_ns = seconds * ns_per_s + in.number<std::uint32_t>();
  (void)in.text();  // frame_id
}

void read_texts(Fields& in, std::vector<std::string_view>& out) {
  out.clear();
  for (auto n = in.count(sizeof(std::uint32_t)); n > 0; --n) out.push_back(in.text());
}

Status read_joint_state(Fields& in, JointNumbers& out) {
  read_texts(in, out.names);
  for (const char* const interface : joint_state_fields) {
    const auto n = in.count(sizeof(double));
    if (n != 0 && n != out.names.size() && in.whole())
      return wrong(fmt::format("{} names but {} of {}", out.names.size(), n, interface));
    for (std::uint32_t k = 0; k < n; ++k) out.values.push_back({out.names[k], interface, in.number<double>()});
  }
  return {};
}

Status read_dynamic_joint_state(Fields& in, JointNumbers& out) {
  read_texts(in, out.names);
  const auto joints = in.count(2 * sizeof(std::uint32_t));
  if (joints != out.names.size() && in.whole())
    return wrong(fmt::format("{} joint_names but {} interface_values", out.names.size(), joints));
  std::vector<std::string_view> interfaces;
  for (std::uint32_t j = 0; j < joints && in.whole(); ++j) {
    read_texts(in, interfaces);
    const auto n = in.count(sizeof(double));
    if (n != interfaces.size() && in.whole())
      return wrong(fmt::format("{} interface_names but {} values", interfaces.size(), n));
    for (std::uint32_t k = 0; k < n; ++k) out.values.push_back({out.names[j], interfaces[k], in.number<double>()});
  }
  return {};
}

/// The form of CDR behind its encapsulation header, which OMG DDSI-RTPS 2.5 defines in section 10.2.
Result<Fields> open_cdr(std::string_view data) {
  if (data.size() < 4) return wrong("is shorter than the header of CDR");
  const int representation = static_cast<unsigned char>(data[0]) << 8 | static_cast<unsigned char>(data[1]);
  if (representation > 1)
    return wrong(fmt::format("is CDR of representation {:#06x}; read are 0x0000 and 0x0001 (XCDR1), as ROS 2 writes",
                             representation));
  const bool little = representation == 1;
  return Fields(
      data.substr(4),
      {.swapped = little != (std::endian::native == std::endian::little), .alignment = 8, .terminated = true});
}

struct Kind {
  JointMessage message;
  std::string_view type, definition;
  Status (*read)(Fields& in, JointNumbers& out);
};
#define TRIBOTWIN_RULE "================================================================================\n"
#define TRIBOTWIN_HEADER             \
  TRIBOTWIN_RULE                     \
  "MSG: std_msgs/Header\n"           \
  "builtin_interfaces/Time stamp\n"  \
  "string frame_id\n" TRIBOTWIN_RULE \
  "MSG: builtin_interfaces/Time\n"   \
  "int32 sec\n"                      \
  "uint32 nanosec\n"
constexpr Kind kinds[] = {
    {JointMessage::joint_state, "sensor_msgs/msg/JointState",
     "std_msgs/Header header\n"
     "string[] name\n"
     "float64[] position\n"
     "float64[] velocity\n"
     "float64[] effort\n" TRIBOTWIN_HEADER,
     read_joint_state},
    {JointMessage::dynamic_joint_state, "control_msgs/msg/DynamicJointState",
     "std_msgs/Header header\n"
     "string[] joint_names\n"
     "InterfaceValue[] interface_values\n" TRIBOTWIN_HEADER TRIBOTWIN_RULE "MSG: control_msgs/InterfaceValue\n"
     "string[] interface_names\n"
     "float64[] values\n",
     read_dynamic_joint_state},
};
#undef TRIBOTWIN_HEADER
#undef TRIBOTWIN_RULE

/// "sensor_msgs/JointState" is the name in ROS 1 and in some JSON.
bool names_type(std::string_view given, std::string_view type) {
  const auto slash = type.find('/');
  return given == type ||
         (given.starts_with(type.substr(0, slash + 1)) && given.substr(slash + 1) == type.substr(type.rfind('/') + 1));
}

const Kind* kind_of(const Channel& channel) {
  const auto found = std::ranges::find_if(kinds, [&](const Kind& k) { return names_type(channel.schema, k.type); });
  return found == std::end(kinds) ? nullptr : found;
}

const Kind& kind_of(JointMessage message) { return *std::ranges::find(kinds, message, &Kind::message); }

}  // namespace

std::optional<JointMessage> joint_message_of(const Channel& channel) {
  const Kind* const kind = kind_of(channel);
  return kind ? std::optional(kind->message) : std::nullopt;
}

Status decode(const Channel& channel, std::string_view data, JointNumbers& out) {
  const Kind* const kind = kind_of(channel);
  if (!kind) return wrong("is no message of joints");
  out.values.clear();
  if (channel.encoding == "json") return decode_json(kind->message, data, out);
  const bool ros1 = channel.encoding == "ros1";
  if (!ros1 && channel.encoding != "cdr")
    return wrong(fmt::format("is encoded as '{}'; read are cdr, ros1 and json", printable(channel.encoding)));
  Result<Fields> in =
      ros1 ? Fields(data, {.swapped = std::endian::native != std::endian::little, .alignment = 1, .terminated = false})
           : open_cdr(data);
  if (!in) return tl::unexpected(in.error());
  read_header(*in, ros1, out);
  const Status read = kind->read(*in, out);
  if (read && !in->whole()) return wrong("ends within its fields");
  return read;
}

std::string_view definition(JointMessage kind) { return kind_of(kind).definition; }
std::string_view type_name(JointMessage kind) { return kind_of(kind).type; }

namespace {

/// Makes a message in little-endian CDR.
class CdrText {
 public:
  explicit CdrText(std::int64_t stamp_ns) : bytes_("\0\1\0\0", begin) {
    std::int64_t seconds = stamp_ns / ns_per_s, rest = stamp_ns % ns_per_s;
    if (rest < 0) --seconds, rest += ns_per_s;
    number(static_cast<std::int32_t>(seconds));
    number(static_cast<std::uint32_t>(rest));
    text("");  // frame_id
  }
  template <class T>
  void number(T value) {
    while ((bytes_.size() - begin) % sizeof value != 0) bytes_ += '\0';
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void text(std::string_view text) {
    length(text.size() + 1);
    bytes_.append(text) += '\0';
  }
  void texts(std::span<const std::string> all) {
    length(all.size());
    for (const auto& one : all) text(one);
  }
  void numbers(std::span<const double> all) {
    length(all.size());
    for (const double x : all) number(x);
  }
  void length(std::size_t count) { number(static_cast<std::uint32_t>(count)); }
  std::string take() { return std::move(bytes_); }

 private:
  static constexpr std::size_t begin = 4;  // alignment counts from behind the encapsulation header
  std::string bytes_;
};

}  // namespace

std::string encode_joint_state(std::int64_t stamp_ns, std::span<const std::string> names,
                               std::span<const double> position, std::span<const double> velocity,
                               std::span<const double> effort) {
  CdrText out(stamp_ns);
  out.texts(names);
  for (const auto& numbers : {position, velocity, effort}) out.numbers(numbers);
  return out.take();
}

std::string encode_dynamic_joint_state(std::int64_t stamp_ns, std::span<const std::string> names,
                                       std::span<const std::string> interfaces, std::span<const double> values) {
  CdrText out(stamp_ns);
  out.texts(names);
  out.length(names.size());
  for (std::size_t j = 0; j < names.size(); ++j) {
    out.texts(interfaces);
    out.numbers(values.subspan(j * interfaces.size(), interfaces.size()));
  }
  return out.take();
}

}  // namespace tribotwin::twin::mcap
