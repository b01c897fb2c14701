// libtribotwin_mpi.so: MPI behind the functions of mpi_functions.hpp. Loaded by mpi.cc when a launcher has started the
// program on several ranks.
#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <list>
#include <string>
#include <thread>

#define OMPI_SKIP_MPICXX 1
#define MPICH_SKIP_MPICXX 1
#include <mpi.h>

#include <tribotwin/twin/numerics/executor/mpi_functions.hpp>

namespace {

struct Sent {
  std::string bytes;
  MPI_Request request = MPI_REQUEST_NULL;
};
std::list<Sent> under_way;  // MPI reads the bytes until the request is complete
MPI_Message found = MPI_MESSAGE_NULL;
constexpr int tag = 22;

void forget_sent() {
  for (auto one = under_way.begin(); one != under_way.end();) {
    int complete = 0;
    MPI_Test(&one->request, &complete, MPI_STATUS_IGNORE);
    one = complete ? under_way.erase(one) : std::next(one);
  }
}

int open(int* rank, int* size) {
  // Open MPI answers a crash with a trace of addresses, behind which the last words of a task would be lost.
  constexpr std::array crashes{SIGABRT, SIGBUS, SIGFPE, SIGSEGV};
  std::array<struct sigaction, crashes.size()> before{};
  for (std::size_t i = 0; i < crashes.size(); ++i) ::sigaction(crashes[i], nullptr, &before[i]);
  // Its shared memory in /dev/shm stays there when ranks are killed together with mpirun; System V's goes with the last
  // process. Where that is not to be had, or the user asks for another one, Open MPI takes the next.
  ::setenv("OMPI_MCA_shmem_sysv_priority", "90", 0);
  int provided = 0;
  if (const int error = MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided)) return error;
  for (std::size_t i = 0; i < crashes.size(); ++i) ::sigaction(crashes[i], &before[i], nullptr);
  MPI_Comm_rank(MPI_COMM_WORLD, rank);
  MPI_Comm_size(MPI_COMM_WORLD, size);
  return 0;
}

int send(int to, const void* bytes, std::size_t size) {
  forget_sent();
  Sent& one = under_way.emplace_back();
  one.bytes.assign(static_cast<const char*>(bytes), size);
  return MPI_Isend(one.bytes.data(), static_cast<int>(size), MPI_BYTE, to, tag, MPI_COMM_WORLD, &one.request);
}

int probe(int* from, std::size_t* size) {
  forget_sent();
  int there = 0, count = 0;
  MPI_Status status;
  MPI_Improbe(MPI_ANY_SOURCE, tag, MPI_COMM_WORLD, &there, &found, &status);
  if (!there) return 0;
  MPI_Get_count(&status, MPI_BYTE, &count);
  *from = status.MPI_SOURCE;
  *size = static_cast<std::size_t>(count);
  return 1;
}

int receive(void* bytes, std::size_t size) {
  return MPI_Mrecv(bytes, static_cast<int>(size), MPI_BYTE, &found, MPI_STATUS_IGNORE);
}

void close() {
  // Asking is quiet where MPI's own waiting would keep a core busy beside the ranks that still work.
  const auto pause = [] { std::this_thread::sleep_for(std::chrono::milliseconds(1)); };
  for (; !under_way.empty(); pause()) forget_sent();
  MPI_Request all = MPI_REQUEST_NULL;
  MPI_Ibarrier(MPI_COMM_WORLD, &all);
  for (int complete = 0; !complete; pause()) MPI_Test(&all, &complete, MPI_STATUS_IGNORE);
  MPI_Finalize();
}

const char* version() {
  static char text[MPI_MAX_LIBRARY_VERSION_STRING];
  int length = 0;
  MPI_Get_library_version(text, &length);
  return text;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const tribotwin_mpi_functions tribotwin_mpi_1;
const tribotwin_mpi_functions tribotwin_mpi_1 = {open, send, probe, receive, close, version};
