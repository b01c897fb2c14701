#pragma once

#include <cstddef>
#include <cstdint>

/// What readers of files accept at most. Each is checked before memory for it is taken: a message names the file, what
/// it has and the limit. Files that are read line by line may be of any length.
namespace tribotwin::limits {

constexpr std::uintmax_t KiB = 1024, MiB = 1024 * KiB, GiB = 1024 * MiB;

// Files that are read as a whole
constexpr std::uintmax_t any_length = static_cast<std::uintmax_t>(-1);
constexpr std::uintmax_t text_bytes = 64 * MiB;   ///< JSON, EDS and DCF, stores of drives, results of other commands
constexpr std::uintmax_t yaml_bytes = 16 * MiB;   ///< scenarios, campaigns, parameters
constexpr std::uintmax_t model_bytes = 32 * MiB;  ///< MJCF and URDF, each file of a model
constexpr std::uintmax_t asset_bytes = 1 * GiB;   ///< a mesh, texture or height field of a model
constexpr std::uintmax_t file_bytes = 64 * GiB;   ///< what is copied or compared as it is, journals

// YAML and JSON
constexpr std::size_t yaml_values = 1'000'000;   ///< with each alias counted as what it stands for
constexpr std::size_t yaml_depth = 64;           ///< mappings and lists in each other
constexpr std::size_t json_values = 10'000'000;  ///< numbers, texts, lists and objects
constexpr std::size_t json_depth = 64;

// Models
constexpr int model_depth = 500;                  ///< elements in each other; the engine stops there, too
constexpr std::ptrdiff_t model_tags = 1'000'000;  ///< of one file: '<'
constexpr double model_user_data = 1e6;           ///< nuserdata
constexpr double model_user_numbers = 1e4;        ///< nuser_body and its like, of one object; nkey
constexpr double model_stack = 1e8;               ///< nstack [numbers]
constexpr double model_constraints = 2e4;         ///< njmax, nconmax; the stack grows with their square
constexpr double model_copies = 1e4;              ///< parts of a composite
constexpr double model_pixels = 4096;             ///< each side of a texture or height field that the model describes

// Tables
constexpr std::size_t csv_line_bytes = 16 * MiB;
constexpr std::uintmax_t array_bytes = 4 * GiB;        ///< of one array or column in memory
constexpr std::size_t array_columns = 100'000;         ///< of all arrays of a file
constexpr std::size_t archive_files = 10'000;          ///< in an .npz
constexpr std::size_t numpy_header_bytes = MiB;        ///< of one array
constexpr std::size_t matlab_variables = 100'000;      ///< of a file of version 4 to 7
constexpr std::size_t struct_depth = 8;                ///< MATLAB structs in each other
constexpr std::uintmax_t csv_numbers_bytes = 8 * GiB;  ///< in memory, of one CSV: two days of four columns at 1 kHz
constexpr std::uintmax_t csv_text_bytes = 256 * MiB;   ///< of a small CSV whose cells are kept as text
constexpr std::uintmax_t mcap_chunk_bytes = GiB;       ///< uncompressed; also of any record as it is in the file
constexpr std::uintmax_t best_compression = 1100;      ///< of deflate: a file cannot hold more times its own length
constexpr std::uintmax_t library_bytes = 256 * MiB;    ///< for HDF5 or MATLAB's format beyond what the file can hold
constexpr std::uintmax_t hdf5_chunk_bytes = 64 * MiB;
constexpr std::size_t hdf5_text_bytes = MiB;  ///< of an attribute
constexpr std::size_t hdf5_links = 10'000;    ///< of a group

// Of the bus
constexpr std::size_t log_line_bytes = 4096;          ///< candump; one byte is the end of the line
constexpr std::size_t session_line_bytes = 16 * MiB;  ///< FILE.session
constexpr std::size_t eds_line_bytes = 4096;          ///< EDS and DCF
constexpr std::size_t eds_objects = 20'000;           ///< EDS and DCF
constexpr std::size_t dbc_line_bytes = 4096;          ///< what is behind is not read: receivers of a signal
constexpr std::size_t dbc_file_line_bytes = MiB;      ///< DBC; a longer line is refused

}  // namespace tribotwin::limits
