#pragma once

#include <array>

#include <tribotwin/hil/canopen/dictionary.hpp>
#include <tribotwin/hil/drives/drive_parameters.hpp>

namespace tribotwin::hil {

inline constexpr int pdo_count = 5;          ///< in each direction
inline constexpr std::size_t pdo_bytes = 8;  ///< a classic frame; also the maximum number of objects in one PDO

/// A PDO as it is after a reset.
struct DefaultPdo {
  std::uint32_t cob;  ///< COB-ID entry, with flag bits
  std::uint8_t type;  ///< transmission type (CiA 301, 7.5.2.35 and 7.5.2.37)
  std::vector<MappingEntry> map;
};
struct DefaultPdos {
  std::array<DefaultPdo, pdo_count> receive, transmit;
};

/// The objects of CiA 301 (1000h to 1FFFh) of a node, its memory for the master and the time
/// that it was told (2180h, 2181h).
void add_communication_objects(std::vector<Object>& objects, const DriveParameters& parameters,
                               std::uint32_t device_type, const DefaultPdos& pdos);

/// Index of a PDO's communication parameter. number = 0 .. pdo_count - 1.
std::uint16_t pdo_index(bool transmit, int number);

/// The parameters of a PDO, as the dictionary has them now.
struct PdoParameters {
  bool exists;
  std::uint32_t cob;  ///< 11-bit identifier
  std::uint8_t type;  ///< transmission type
  std::vector<MappingEntry> map;
};
PdoParameters pdo_parameters(const Dictionary& dictionary, bool transmit, int number);

}  // namespace tribotwin::hil
