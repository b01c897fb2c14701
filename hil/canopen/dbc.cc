#include <fmt/format.h>

#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/dbc.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/drives/identifier.hpp>

namespace tribotwin::hil {
namespace {

std::string quoted(std::string text) {
  for (char& c : text)
    if (c == '"' || c == '\\' || static_cast<unsigned char>(c) < 0x20) c = '\'';
  return text;
}

std::string node_name(const DriveParameters& p) { return fmt::format("n{}_{}", p.node, identifier(p.name)); }

/// Messages and comments of one file.
class Dbc {
 public:
  void add(const DescribedDrive& drive) {
    for (const bool transmit : {false, true})
      for (int i = 0; i < pdo_count; ++i) add_pdo(drive, transmit, i);
  }
  std::string text() const { return messages_ + "\n" + comments_; }

 private:
  void add_pdo(const DescribedDrive& drive, bool transmit, int number) {
    const DriveParameters& p = *drive.parameters;
    const auto pdo = pdo_parameters(*drive.dictionary, transmit, number);
    if (!pdo.exists) return;
    const std::string node = node_name(p).substr(0, longest_identifier);
    std::string signals;
    int bit = 0;
    for (const MappingEntry& entry : pdo.map) {
      if (const Object* o = drive.dictionary->find(entry.index, entry.sub)) {
        signals += signal(*o, bit, entry.bits, p.gear_ratio) + (transmit ? "master" : node) + "\n";
        if (!o->meaning.empty())
          comments_ += fmt::format("CM_ SG_ {} {} \"{}\";\n", pdo.cob, identifier(o->name), quoted(o->meaning));
      }
      bit += entry.bits;
    }
    const std::string name =
        fmt::format("{}PDO{}_{}", transmit ? "T" : "R", number + 1, node).substr(0, longest_identifier);
    messages_ += fmt::format("BO_ {} {}: {} {}\n{}\n", pdo.cob, name, bit / 8, transmit ? node : "master", signals);
    comments_ += fmt::format("CM_ BO_ {} \"{}, node {}, joint {}\";\n", pdo.cob,
                             transmit ? "from the drive" : "to the drive", p.node, quoted(p.name));
  }

  /// Up to the receiver's name.
  static std::string signal(const Object& o, int bit, int bits, double gear_ratio) {
    const double scale = o.unit == "rad" || o.unit == "rad/s" ? o.scale / gear_ratio : o.scale;
    return fmt::format(" SG_ {} : {}|{}@1{} ({},0) [0|0] \"{}\" ", identifier(o.name), bit, bits,
                       is_signed(o.type) ? '-' : '+', scale, quoted(o.unit));
  }

  std::string messages_, comments_;
};

}  // namespace

std::string dbc(std::span<const DescribedDrive> drives) {
  std::string nodes;
  Dbc file;
  for (const auto& drive : drives) {
    nodes += fmt::format(" {:.32}", node_name(*drive.parameters));
    file.add(drive);
  }
  return "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: master" + nodes + "\n\n" + file.text();
}

}  // namespace tribotwin::hil
