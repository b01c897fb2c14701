#pragma once

#include <chrono>
#include <cstddef>

/// Bounds of what a live bench does for those who ask.
namespace tribotwin::twin::live {

struct Limits {
  std::size_t connections = 64, viewers = 16;  ///< at once; a viewer is a connection too
  std::chrono::milliseconds header{5000};      ///< for a whole request
  std::chrono::milliseconds response{30000};   ///< for a whole response, and for a silent viewer
  std::size_t header_bytes = 8192;
  std::size_t message_bytes = 4096;         ///< of a page
  int messages_per_s = 20;                  ///< of one page, pings among them
  std::size_t bytes_per_s = 128 << 10;      ///< that are read of one connection; more waits with who sends it
  std::size_t row_bytes = 1 << 20;          ///< that wait for one viewer; older rows are lost to it
  std::size_t memory_bytes = 128 << 20;     ///< of the last rows, which can be exported
  std::size_t texts = 256;                  ///< that wait for one viewer; with more it is sent away
  std::size_t events = 200;                 ///< that a new viewer is told of
  int batches_per_s = 120;                  ///< of rows
  int poses_per_s = 30;                     ///< the newest of them
  std::chrono::milliseconds farewell{500};  ///< for what is left at the end
};

}  // namespace tribotwin::twin::live
