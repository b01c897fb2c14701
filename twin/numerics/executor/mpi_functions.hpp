#pragma once

#include <cstddef>

/// What libtribotwin_mpi.so offers: the few functions of MPI that the program needs, so that the program itself is not
/// linked to any MPI. One thread calls them.
struct tribotwin_mpi_functions {
  /// MPI_Init; 0, or MPI's error code.
  int (*open)(int* rank, int* size);
  /// Copies the bytes and sends them without waiting; at most INT_MAX bytes.
  int (*send)(int to, const void* bytes, std::size_t size);
  /// Whether a message has arrived: its sender and size.
  int (*probe)(int* from, std::size_t* size);
  /// Receives the message that `probe` has found.
  int (*receive)(void* bytes, std::size_t size);
  /// Waits for all that was sent, then MPI_Finalize.
  void (*close)();
  /// Version of the MPI library.
  const char* (*version)();
};

/// The one symbol that the program looks up; its number changes with the struct.
#define TRIBOTWIN_MPI_SYMBOL "tribotwin_mpi_1"
