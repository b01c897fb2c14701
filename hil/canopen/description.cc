#include <algorithm>
#include <iterator>
#include <map>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/description.hpp>

namespace tribotwin::hil {
namespace {

/// A name as a DBC identifier: letters, digits, underscores.
std::string identifier(std::string_view name) {
  std::string out;
  for (const char c : name) out += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  if (out.empty() || (out[0] >= '0' && out[0] <= '9')) out.insert(out.begin(), '_');
  return out.substr(0, 32);
}

std::string quoted(std::string text) {
  for (char& c : text)
    if (c == '"' || c == '\\' || static_cast<unsigned char>(c) < 0x20) c = '\'';
  return text;
}

/// One line of an INI value, ASCII.
std::string one_line(std::string text) {
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  return text;
}

/// Arrays of CiA 301 and 402; what else has sub-indices is a record.
bool is_array(std::uint16_t index) {
  constexpr std::uint16_t arrays[] = {0x1003, 0x1016, 0x1029, 0x607D, 0x608F, 0x6091};
  return std::ranges::find(arrays, index) != std::end(arrays);
}

int data_type(Type type) {
  constexpr int types[] = {0x05, 0x06, 0x07, 0x02, 0x03, 0x04, 0x09};
  return types[static_cast<int>(type)];
}

/// Of an array or a record, as CiA 301 and 402 call it; of our own ones, as their first entry is called.
std::string name_of_all(std::uint16_t index, const std::vector<const Object*>& objects) {
  static const std::map<std::uint16_t, std::string> standard{{0x1003, "pre-defined error field"},
                                                             {0x1016, "consumer heartbeat time"},
                                                             {0x1018, "identity object"},
                                                             {0x1029, "error behavior"},
                                                             {0x1200, "SDO server parameter"},
                                                             {0x607D, "software position limit"},
                                                             {0x608F, "position encoder resolution"},
                                                             {0x6091, "gear ratio"},
                                                             {0x60C2, "interpolation time period"}};
  if (const auto known = standard.find(index); known != standard.end()) return known->second;
  if (index >= 0x1400 && index < 0x1C00)
    return fmt::format("{}PDO{} {} parameter", index < 0x1800 ? 'R' : 'T', (index & 0x1ff) + 1,
                       (index & 0x200) ? "mapping" : "communication");
  return objects[objects.size() > 1 ? 1 : 0]->name;
}

}  // namespace

std::string eds(const Dictionary& dictionary, const DriveParameters& p) {
  std::map<std::uint16_t, std::vector<const Object*>> by_index;
  for (const Object& o : dictionary.objects()) by_index[o.index].push_back(&o);
  std::string s = fmt::format(
      "[FileInfo]\nFileName=tribotwin_node{0}.eds\nFileVersion=1\nFileRevision=1\nEDSVersion=4.0\nDescription="
      "tribotwin drive {1}\n"
      // Constant times: the same drive gives the same file.
      "CreationTime=12:00AM\nCreationDate=01-01-2026\nCreatedBy=tribotwin-hil\nModificationTime=12:"
      "00AM\nModificationDate=01-01-2026\nModifiedBy=tribotwin-hil\n\n"
      "[DeviceInfo]\nVendorName=tribotwin\nVendorNumber=0x0\nProductName=tribotwin "
      "drive\nProductNumber=0x7477\nRevisionNumber=0x10000\nOrderCode=\n"
      "BaudRate_10=0\nBaudRate_20=0\nBaudRate_50=0\nBaudRate_125=1\nBaudRate_250=1\nBaudRate_500=1\nBaudRate_800="
      "1\nBaudRate_1000=1\n"
      "SimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported=0\nGroupMessaging="
      "0\nNrOfRXPDO={2}\nNrOfTXPDO={2}\nLSS_Supported=0\n\n"
      "[DummyUsage]\nDummy0001=0\nDummy0002=1\nDummy0003=1\nDummy0004=1\nDummy0005=1\nDummy0006=1\nDummy0007=1\n\n["
      "Comments]\nLines=0\n\n",
      p.node, one_line(p.name), pdo_count);
  const auto mandatory = [](std::uint16_t i) { return i == 0x1000 || i == 0x1001 || i == 0x1018; };
  const auto list = [&](const char* title, auto belongs) {
    std::string lines;
    int n = 0;
    for (const auto& [index, objects] : by_index)
      if (belongs(index)) lines += fmt::format("{}=0x{:04X}\n", ++n, index);
    s += fmt::format("[{}]\nSupportedObjects={}\n{}\n", title, n, lines);
  };
  list("MandatoryObjects", mandatory);
  list("OptionalObjects", [&](std::uint16_t i) { return !mandatory(i) && (i < 0x2000 || i >= 0x6000); });
  list("ManufacturerObjects", [](std::uint16_t i) { return i >= 0x2000 && i < 0x6000; });
  const auto body = [&](const Object& o) {
    const bool number = o.type != Type::text;
    s += fmt::format("ParameterName={}\nObjectType=0x7\nDataType=0x{:04X}\nAccessType={}\n", one_line(o.name),
                     data_type(o.type),
                     o.access == Access::read_write ? "rw"
                     : o.access == Access::constant ? "const"
                                                    : "ro");
    if (number && o.access == Access::read_write) s += fmt::format("LowLimit={}\nHighLimit={}\n", o.low, o.high);
    s += fmt::format("DefaultValue={}\nPDOMapping={}\n\n", number ? fmt::to_string(o.value) : one_line(o.text),
                     o.mappable ? 1 : 0);
  };
  for (const auto& [index, objects] : by_index) {
    if (objects.size() == 1 && objects[0]->sub == 0) {
      s += fmt::format("[{:04X}]\n", index);
      body(*objects[0]);
      continue;
    }
    s += fmt::format("[{:04X}]\nParameterName={}\nObjectType={}\nSubNumber={}\n\n", index,
                     one_line(name_of_all(index, objects)), is_array(index) ? "0x8" : "0x9", objects.size());
    for (const Object* o : objects) {
      s += fmt::format("[{:04X}sub{:X}]\n", index, o->sub);
      body(*o);
    }
  }
  return s;
}

std::string dbc(std::span<const DescribedDrive> drives) {
  std::string s = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: master", messages, comments;
  for (const auto& d : drives)
    s += fmt::format(" n{}_{}", d.parameters->node, identifier(d.parameters->name)).substr(0, 33);
  s += "\n\n";
  for (const auto& d : drives) {
    const auto& dictionary = *d.dictionary;
    const std::string node = fmt::format("n{}_{}", d.parameters->node, identifier(d.parameters->name)).substr(0, 32);
    for (int way = 0; way < 2; ++way)
      for (std::uint16_t i = 0; i < pdo_count; ++i) {
        const auto at = static_cast<std::uint16_t>((way ? 0x1800 : 0x1400) + i),
                   map = static_cast<std::uint16_t>(at + 0x200);
        const std::int64_t cob = dictionary.get(at, 1);
        if (cob & 0x80000000) continue;
        std::string signals;
        int bit = 0;
        for (std::uint8_t k = 1; k <= dictionary.get(map, 0); ++k) {
          const auto entry = static_cast<std::uint32_t>(dictionary.get(map, k));
          const int bits = static_cast<int>(entry & 0xff);
          if (const Object* o =
                  const_cast<Dictionary&>(dictionary)
                      .find(static_cast<std::uint16_t>(entry >> 16), static_cast<std::uint8_t>(entry >> 8))) {
            const double scale =
                o->unit == "rad" || o->unit == "rad/s" ? o->scale / d.parameters->gear_ratio : o->scale;
            signals += fmt::format(" SG_ {} : {}|{}@1{} ({},0) [0|0] \"{}\" {}\n", identifier(o->name), bit, bits,
                                   is_signed(o->type) ? '-' : '+', scale, quoted(o->unit), way ? "master" : node);
            if (!o->meaning.empty())
              comments += fmt::format("CM_ SG_ {} {} \"{}\";\n", cob & 0x7ff, identifier(o->name), quoted(o->meaning));
          }
          bit += bits;
        }
        messages += fmt::format("BO_ {} {}: {} {}\n{}\n", cob & 0x7ff,
                                fmt::format("{}PDO{}_{}", way ? "T" : "R", i + 1, node).substr(0, 32), bit / 8,
                                way ? node : "master", signals);
        comments +=
            fmt::format("CM_ BO_ {} \"{}, node {}, joint {}\";\n", cob & 0x7ff, way ? "from the drive" : "to the drive",
                        d.parameters->node, quoted(d.parameters->name));
      }
  }
  return s + messages + "\n" + comments;
}

}  // namespace tribotwin::hil
