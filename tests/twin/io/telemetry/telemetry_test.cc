#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <new>
#include <random>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <malloc.h>
#include <sys/wait.h>
#include <unistd.h>

#include <tribotwin/tests/allocations.hpp>
#include <tribotwin/tests/small_disk.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>
#include <tribotwin/twin/io/telemetry/reader.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

namespace tribotwin::twin {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::ElementsAreArray;
using testing::HasSubstr;
using testing::Pair;
using Values = std::vector<double>;

double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class TelemetryTest : public testing::Test {
 protected:
  fs::path folder = [] {
    std::string name = (fs::temp_directory_path() / "tribotwin_XXXXXX").string();
    return fs::path(mkdtemp(name.data()));
  }();
  fs::path file = folder / "telemetry.h5";
  void TearDown() override { fs::remove_all(folder); }
  double clock_s = 0;
  TelemetryOptions options(std::vector<std::string> joints) {
    return {.attributes = {{"engine", "test"}},
            .joints = std::move(joints),
            .channels = {{"a", "rad", "an angle"}, {"b", "Nm", "a torque"}},
            .cycle_channels = {{"cycle_a", "degC", "per cycle"}},
            .wall_clock_s = [this] { return clock_s; }};
  }
};

// A record of hours took as much memory as its file, up to 1 MiB for each column.
TEST_F(TelemetryTest, ALongRecordTakesNoMoreMemoryThanAShortOne) {
  auto t = Telemetry::create(file, options({"one", "two"}));
  ASSERT_TRUE(t) << t.error().message;
  std::size_t used = 0;
  for (int i = 0; i < 100000; ++i) {
    ASSERT_TRUE(t->append(i, Values{1, 2, 3, 4}));
    if (i == 20000) used = ::mallinfo2().uordblks;
  }
  EXPECT_LT(::mallinfo2().uordblks, used + 200000);  // of 80,000 rows of 40 bytes
  ASSERT_TRUE(t->finish());
}

TEST_F(TelemetryTest, ReadsBackWhatWasWritten) {
  auto o = options({"two", "one"});
  o.attributes.insert(o.attributes.begin(), {"seed", ""});
  o.joint_attributes = {{{"torque_max_nm", 3.5}, {"gear_ratio", 178}}, {{"gear_ratio", 100}}};
  auto t = Telemetry::create(file, o);
  ASSERT_TRUE(t) << t.error().message;
  for (int i = 0; i < 10000; ++i) ASSERT_TRUE(t->append(i, Values{i + .1, i + .2, i + .3, i + .4}));
  ASSERT_TRUE(t->append_cycle(7, Values{1, 2}));
  ASSERT_TRUE(t->finish());
  const auto r = read_telemetry(file);
  ASSERT_TRUE(r) << r.error().message;
  EXPECT_TRUE(r->complete);
  EXPECT_THAT(r->attributes, ElementsAre(Pair("seed", ""), Pair("engine", "test")));
  EXPECT_THAT(r->joints, ElementsAre("two", "one"));
  EXPECT_THAT(r->joint_attributes, ElementsAre(ElementsAre(Pair("torque_max_nm", 3.5), Pair("gear_ratio", 178)),
                                               ElementsAre(Pair("gear_ratio", 100))));
  ASSERT_EQ(r->time_s.size(), 10000u);
  EXPECT_EQ(r->channel("one", "a")[4321], 4321.3);
  EXPECT_THAT(r->channel("one", "cycle_a"), ElementsAre(2));
  EXPECT_THAT(r->channel("one", "none"), ElementsAre());
  EXPECT_EQ(r->channels[1].unit, "Nm");
  EXPECT_EQ(r->channels[1].description, "a torque");
}

TEST_F(TelemetryTest, OddJointNamesSurviveAndDoublesAreRefused) {
  const std::vector<std::string> names{"a/b",   "",   ".", "\u00fc \"x\",y", "complete", "time_s", "%",
                                       "a%2Fb", "..", "_", "a\u2215b"};
  auto t = Telemetry::create(file, options(names));
  ASSERT_TRUE(t) << t.error().message;
  ASSERT_TRUE(t->append(0, Values(2 * names.size(), 1.5)));
  ASSERT_TRUE(t->finish());
  EXPECT_THAT(read_telemetry(file)->joints, ElementsAreArray(names));
  ASSERT_TRUE(export_csv(folder, Existing::refuse));
  EXPECT_THAT(text_of(folder / "telemetry.csv"), HasSubstr(",\"\u00fc \"\"x\"\",y.a\","));
  EXPECT_THAT(Telemetry::create(folder / "d.h5", options({"x", "x"})).error().message,
              HasSubstr("two joints are called 'x'"));
  EXPECT_THAT(Telemetry::create(folder / "d.h5", options({std::string("x\0y", 3)})).error().message, HasSubstr("NUL"));
  EXPECT_FALSE(fs::exists(folder / "d.h5"));
}

TEST_F(TelemetryTest, CycleChannelsNeedNoPrefix) {
  auto o = options({"one"});
  o.cycle_channels = {{"heat_J", "J", ""}};
  auto t = Telemetry::create(file, o);
  for (int i = 0; i < 10; ++i) ASSERT_TRUE(t->append(i, Values{1, 2}));
  ASSERT_TRUE(t->append_cycle(3, Values{4}));
  ASSERT_TRUE(t->finish());
  const auto r = read_telemetry(file);
  EXPECT_EQ(r->time_s.size(), 10u);
  EXPECT_THAT(r->channel("one", "heat_J"), ElementsAre(4));
}

TEST_F(TelemetryTest, FlushesByTheClockAndStaysMarkedUntilFinished) {
  {
    auto t = Telemetry::create(file, options({"one"}));
    ASSERT_TRUE(t);
    ASSERT_TRUE(t->append(0, Values{1, 2}));
    EXPECT_EQ(read_telemetry(file)->time_s.size(), 0u);
    clock_s = 0.6;
    ASSERT_TRUE(t->append(1, Values{1, 2}));
    const auto seen = read_telemetry(file);
    ASSERT_TRUE(seen) << seen.error().message;
    EXPECT_EQ(seen->time_s.size(), 2u);
    EXPECT_FALSE(seen->complete);
    ASSERT_TRUE(t->append(2, Values{1, 2}));
  }
  EXPECT_EQ(read_telemetry(file)->time_s.size(), 3u);
  EXPECT_FALSE(read_telemetry(file)->complete);
}

TEST_F(TelemetryTest, AppendingAllocatesNothing) {
  auto t = Telemetry::create(file, options({"one", "two"}));
  const Values row(4, 1.0), cycle(2, 1.0);
  const long before = allocations;
  for (int i = 0; i < 10000; ++i) {
    clock_s = i * 1e-3;
    if (!t->append(i, row) || !t->append_cycle(i, cycle)) FAIL();
  }
  EXPECT_EQ(allocations, before);
}

TEST_F(TelemetryTest, WrongUseIsRefused) {
  auto t = Telemetry::create(file, options({"one"}));
  EXPECT_THAT(t->append(0, Values{1}).error().message, HasSubstr("1 values given where a row has 2"));
  EXPECT_TRUE(t->append(0, Values{1, 2}));
  EXPECT_THAT(recover(folder).error().message, HasSubstr("a run is still writing it"));
  EXPECT_THAT(Telemetry::create(file, options({"one"})).error().message, HasSubstr("a run is still writing it"));
  EXPECT_TRUE(t->finish());
  EXPECT_THAT(t->append(1, Values{1, 2}).error().message, HasSubstr("is finished"));
  EXPECT_THAT(t->finish().error().message, HasSubstr("is finished"));
  EXPECT_EQ(read_telemetry(file)->time_s.size(), 1u);
  EXPECT_THAT(Telemetry::create(file, options({"one"})).error().message, HasSubstr("exists"));
  EXPECT_TRUE(Telemetry::create(file, options({"one"}), Existing::replace));
}

// The times are wall times, so the last one recovered shows what was lost.
TEST_F(TelemetryTest, KilledRunLosesAtMostItsLastSecond) {
  for (const double pause_s : {1e-5, 1e-2}) {
    const pid_t child = fork();
    if (child == 0) {
      auto o = options({"one", "two"});
      o.wall_clock_s = nullptr;
      o.joint_attributes = {{{"gear_ratio", 2}}, {}};
      auto t = Telemetry::create(file, o, Existing::replace);
      for (Values row(4), cycle(2); t;) {
        const double time_s = now_s();
        std::ranges::fill(row, time_s);
        if (!t->append(time_s, row) || !t->append_cycle(time_s, cycle)) break;
        std::this_thread::sleep_for(std::chrono::duration<double>(pause_s));
      }
      _exit(1);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1700));
    const double killed_s = now_s();
    kill(child, SIGKILL);
    int state = 0;
    waitpid(child, &state, 0);
    ASSERT_TRUE(WIFSIGNALED(state));

    const auto before = read_telemetry(file);
    ASSERT_TRUE(before) << before.error().message;
    const auto recovered = recover(folder);
    ASSERT_TRUE(recovered) << recovered.error().message;
    EXPECT_GT(recovered->last_time_s, killed_s - 1);
    EXPECT_FALSE(recovered->was_plain);
    EXPECT_EQ(recovered->lost_samples, 0u);
    EXPECT_TRUE(fs::remove(folder / "telemetry.h5.original"));
    const auto r = read_telemetry(file);
    ASSERT_TRUE(r) << r.error().message;
    EXPECT_FALSE(r->complete);
    EXPECT_EQ(r->time_s.size(), recovered->samples);
    EXPECT_TRUE(r->time_s == before->time_s);
    EXPECT_TRUE(r->cycle_time_s == before->cycle_time_s);
    EXPECT_TRUE(std::ranges::equal(r->channel("two", "b"), r->time_s));
    EXPECT_THAT(r->attributes, ElementsAre(Pair("engine", "test")));
    EXPECT_THAT(r->joint_attributes[0], ElementsAre(Pair("gear_ratio", 2)));
    EXPECT_THAT(std::distance(fs::directory_iterator(folder), {}), 1);
    EXPECT_EQ(recover(folder)->samples, recovered->samples);
  }
}

TEST_F(TelemetryTest, FinishedRecordNeedsNoRecovery) {
  auto t = Telemetry::create(file, options({"one"}));
  ASSERT_TRUE(t->append(3, Values{1, 2}));
  ASSERT_TRUE(t->finish());
  const std::string bytes = text_of(file);
  const auto r = recover(folder);
  ASSERT_TRUE(r) << r.error().message;
  EXPECT_TRUE(r->was_plain);
  EXPECT_EQ(r->samples, 1u);
  EXPECT_EQ(r->last_time_s, 3);
  EXPECT_EQ(text_of(file), bytes);
}

TEST_F(TelemetryTest, FullDiskKeepsWhatWasWritten) {
  // In a process of its own, as a run is: after a failure the file stays open until its process ends.
  int counts[2];
  ASSERT_EQ(pipe(counts), 0);
  const pid_t child = fork();
  if (child == 0) {
    std::size_t appended = 0;
    {
      const SmallDisk disk(1'200'000);
      std::string error;
      auto t = Telemetry::create(file, options({"one", "two"}));
      EXPECT_TRUE(t) << t.error().message;
      for (; appended < 1'000'000; ++appended)
        if (auto ok = t->append(static_cast<double>(appended), Values(4, static_cast<double>(appended))); !ok) {
          error = ok.error().message;
          break;
        }
      EXPECT_EQ(error, file.string() + ": recording stopped (File too large)");
      EXPECT_EQ(t->append(0, Values(4)).error().message, error);
      EXPECT_EQ(t->append_cycle(0, Values(2)).error().message, error);
      EXPECT_EQ(t->finish().error().message, error);
    }
    if (write(counts[1], &appended, sizeof appended) != sizeof appended) _exit(2);
    _exit(HasFailure() ? 1 : 0);
  }
  std::size_t appended = 0;
  ASSERT_EQ(read(counts[0], &appended, sizeof appended), static_cast<ssize_t>(sizeof appended));
  int state = 0;
  waitpid(child, &state, 0);
  ASSERT_TRUE(WIFEXITED(state) && WEXITSTATUS(state) == 0);
  const auto r = read_telemetry(file);
  ASSERT_TRUE(r) << r.error().message;
  EXPECT_FALSE(r->complete);
  EXPECT_GT(r->time_s.size() + 4097, appended);
  EXPECT_EQ(r->time_s.back(), static_cast<double>(r->time_s.size() - 1));
  EXPECT_TRUE(std::ranges::equal(r->channel("two", "b"), r->time_s));
  std::string bytes = text_of(file);
  bytes[bytes.size() * 2 / 3] ^= 1;
  std::ofstream(file, std::ios::binary) << bytes;
  {
    const SmallDisk disk(300'000);
    EXPECT_THAT(recover(folder).error().message, HasSubstr("telemetry.h5: cannot be written (File too large)"));
    EXPECT_THAT(export_csv(folder, Existing::refuse).error().message,
                HasSubstr("telemetry.csv: cannot be written (File too large)"));
  }
  EXPECT_EQ(text_of(file), bytes);
  EXPECT_THAT(std::distance(fs::directory_iterator(folder), {}), 1);
  const auto recovered = recover(folder);
  ASSERT_TRUE(recovered) << recovered.error().message;
  EXPECT_EQ(recovered->samples + recovered->lost_samples, r->time_s.size());
  EXPECT_EQ(recovered->lost_samples, 1024u);
  EXPECT_EQ(text_of(folder / "telemetry.h5.original"), bytes);
  const auto kept = read_telemetry(file);
  ASSERT_TRUE(kept) << kept.error().message;
  EXPECT_TRUE(std::ranges::includes(r->time_s, kept->time_s));
  EXPECT_TRUE(std::ranges::equal(kept->channel("two", "b"), kept->time_s));
  EXPECT_FALSE(fs::exists(folder / "telemetry.csv"));
}

TEST_F(TelemetryTest, FailuresNameTheFileAndTheReason) {
  const fs::path nowhere = folder / "nowhere" / "x.h5";
  EXPECT_THAT(Telemetry::create(nowhere, options({"a"})).error().message,
              nowhere.string() + ": cannot be written (No such file or directory)");
  EXPECT_THAT(Telemetry::create(folder, options({"a"})).error().message,
              folder.string() + ": cannot be written (Is a directory)");
  EXPECT_THAT(read_telemetry(file).error().message, file.string() + ": does not exist");
  std::ofstream(file) << "junk";
  EXPECT_THAT(read_telemetry(file).error().message, HasSubstr("telemetry.h5: is no readable HDF5"));
  EXPECT_THAT(recover(folder).error().message, HasSubstr("telemetry.h5: is no readable HDF5"));
  EXPECT_THAT(export_csv(folder, Existing::refuse).error().message, HasSubstr("telemetry.h5: is no readable HDF5"));
  EXPECT_FALSE(fs::exists(folder / "telemetry.csv"));
}

TEST_F(TelemetryTest, TruncatedRecordIsAnErrorAtEveryLength) {
  auto t = Telemetry::create(file, options({"one"}));
  for (int i = 0; i < 9000; ++i) ASSERT_TRUE(t->append(i, Values{1, 2}));
  ASSERT_TRUE(t->finish());
  for (std::uintmax_t size = fs::file_size(file); size > 0; size = size * 9 / 10) {
    fs::resize_file(file, size - 1);
    EXPECT_THAT(read_telemetry(file).error().message, HasSubstr("telemetry.h5: is no readable HDF5")) << size;
    EXPECT_FALSE(recover(folder));
  }
}

// A foreign record must not reveal the content of other files of this machine.
TEST_F(TelemetryTest, ARecordThatRefersToOtherFilesIsRefused) {
  const std::string secret = (folder / "secret.bin").string();
  std::ofstream(secret, std::ios::binary) << std::string(80, 'x');
  const std::pair<const char*, const char*> cases[] = {
      {"f['one'].create_dataset('b', shape=(10,), dtype='f8', external=[(secret, 0, 80)])", "is stored in other files"},
      {"f['one']['b'] = h5py.ExternalLink(folder + '/other.h5', '/one/b')", "is a link to elsewhere"},
      {"f['one']['b'] = h5py.SoftLink('/one/a')", "is a link to elsewhere"},
      {"layout = h5py.VirtualLayout(shape=(10,), dtype='f8'); layout[:] = h5py.VirtualSource(folder + '/other.h5', "
       "'one/b', shape=(10,)); f['one'].create_virtual_dataset('b', layout)",
       "is stored in other files"},
      {"f['joint'] = h5py.ExternalLink(folder + '/other.h5', '/one')", "is a link to elsewhere"}};
  for (const fs::path& each : {file, folder / "other.h5"}) {
    auto t = Telemetry::create(each, options({"one"}));
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(t->append(i, Values{1, 2}));
    ASSERT_TRUE(t->finish());
  }
  const fs::path good = folder / "good.h5";
  fs::copy_file(file, good);
  for (const auto& [change, says] : cases) {
    fs::copy_file(good, file, fs::copy_options::overwrite_existing);
    const std::string script = fmt::format(
        "import h5py\nfolder, secret = '{}', '{}'\nf = h5py.File('{}', 'r+')\ndel f['one']['b']\n{}\nf.close()\n",
        folder.string(), secret, file.string(), change);
    std::ofstream(folder / "change.py") << script;
    ASSERT_EQ(std::system(fmt::format("/usr/bin/python3 '{}'", (folder / "change.py").string()).c_str()), 0);
    EXPECT_THAT(read_telemetry(file).error().message, HasSubstr(says)) << change;
    EXPECT_THAT(export_csv(folder, Existing::refuse).error().message, HasSubstr(says)) << change;
    EXPECT_THAT(recover(folder).error().message, HasSubstr(says)) << change;
    EXPECT_FALSE(fs::exists(folder / "telemetry.csv"));
  }
}

TEST_F(TelemetryTest, ARecordThatPromisesTooMuchTakesNoMemory) {
  const std::pair<const char*, const char*> cases[] = {
      {"f['one'].create_dataset('b', shape=(1 << 40,), chunks=(1024,), dtype='f8')", "is longer than the file"},
      {"f['one'].create_dataset('b', shape=(10,), maxshape=(None,), chunks=(1 << 28,), dtype='f8')",
       "has chunks of 268435456 rows"},
      {"f['one'].create_dataset('b', shape=(10,), dtype='S70000')", "does not hold numbers"},
      {"f['one']['b'] = f['one']['a'][:]; f['one']['b'].attrs['unit'] = np.bytes_(b'x' * (1 << 21))",
       "at most 1048576 are read"}};
  {
    auto t = Telemetry::create(file, options({"one"}));
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(t->append(i, Values{1, 2}));
    ASSERT_TRUE(t->finish());
  }
  const fs::path good = folder / "good.h5";
  fs::copy_file(file, good);
  for (const auto& [change, says] : cases) {
    fs::copy_file(good, file, fs::copy_options::overwrite_existing);
    std::ofstream(folder / "change.py") << fmt::format(
        "import h5py, numpy as np\nf = h5py.File('{}', 'r+', libver='latest')\ndel f['one']['b']\n{}\nf.close()\n",
        file.string(), change);
    ASSERT_EQ(std::system(fmt::format("/usr/bin/python3 '{}'", (folder / "change.py").string()).c_str()), 0);
    EXPECT_THAT(read_telemetry(file).error().message, HasSubstr(says)) << change;
  }
}

// Asked for one by one, 2,000 names of a group take 50 times as long as its making.
TEST_F(TelemetryTest, ListingLinksTakesLessThanMakingThem) {
  constexpr int count = 2000;
  const auto cpu_s = [] {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  };
  const hdf5::Hdf5 hdf5;
  for (const unsigned order :
       std::initializer_list<unsigned>{0, H5P_CRT_ORDER_TRACKED, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED}) {
    const hdf5::Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose), creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    hdf5::check(H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST));
    hdf5::check(H5Pset_link_creation_order(creation, order));
    const hdf5::Id opened(H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), H5Fclose),
        group(H5Gcreate2(opened, "group", H5P_DEFAULT, creation, H5P_DEFAULT), H5Gclose);
    std::vector<std::string> names;
    const double begun_s = cpu_s();
    for (int i = 0; i < count; ++i) {
      names.push_back(fmt::format("joint{}", (7 * i) % count));
      const hdf5::Id made(H5Gcreate2(group, names.back().c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
    }
    const double made_s = cpu_s();
    const auto found = hdf5::link_names(group);
    EXPECT_LT(cpu_s() - made_s, 2 * (made_s - begun_s)) << order;
    if (order == 0) std::ranges::sort(names);
    EXPECT_EQ(found, names) << order;
  }
}

TEST_F(TelemetryTest, ACrashInTheLibraryIsFoundByAChild) {
  const auto survives = [](const std::function<void()>& work) { return hdf5::survives(work, std::uintmax_t{1} << 24); };
  for (const auto of_parent : {SIG_DFL, SIG_IGN}) {  // a child of a parent that ignores SIGCHLD leaves no state
    const auto before = std::signal(SIGCHLD, of_parent);
    EXPECT_TRUE(survives([] {}));
    EXPECT_TRUE(survives([] { throw std::runtime_error("not a crash"); }));
    EXPECT_FALSE(survives([] { std::abort(); }));
    std::signal(SIGCHLD, before);
  }
  EXPECT_FALSE(survives([] { raise(SIGKILL); }));
  EXPECT_TRUE(survives([] { std::vector<char>(std::size_t{1} << 22, 'x'); }));
  EXPECT_FALSE(survives([] { std::vector<char>(std::size_t{1} << 26, 'x'); }));
}

// For any changed byte: an error, or the same values. Where HDF5 itself crashes, the child does.
TEST_F(TelemetryTest, AChangedByteNeverChangesAValue) {
  {
    auto t = Telemetry::create(file, options({"one", "two"}));
    for (int i = 0; i < 3000; ++i) ASSERT_TRUE(t->append(i, Values{i + .1, i + .2, i + .3, i + .4}));
    ASSERT_TRUE(t->finish());
  }
  const auto truth = read_telemetry(file);
  const std::string bytes = text_of(file);
  std::mt19937 random(1);
  int errors = 0;
  for (int i = 0; i < 150; ++i) {
    std::string changed = bytes;
    // Half of them where the structure is, which is most of what crashes.
    const std::size_t at = random() % (i % 2 ? bytes.size() : std::min<std::size_t>(bytes.size(), 12000));
    changed[at] = static_cast<char>(changed[at] ^ (1 << random() % 8));
    std::ofstream(file, std::ios::binary) << changed;
    const auto r = read_telemetry(file);
    errors += !r;
    if (r) {
      EXPECT_TRUE(r->time_s == truth->time_s && r->values == truth->values && r->joints == truth->joints) << at;
    }
  }
  EXPECT_GT(errors, 50);
}

TEST_F(TelemetryTest, CsvHasEveryDigit) {
  auto t = Telemetry::create(file, options({"one"}));
  const Values odd{0.1, -1e-300, 1.0 / 3, std::numeric_limits<double>::max(), 5e-324, -0.0, 123456789.123456789};
  for (std::size_t i = 0; i < 5000; ++i)
    ASSERT_TRUE(
        t->append(static_cast<double>(i) * 1e-3, Values{odd[i % odd.size()], std::sin(static_cast<double>(i))}));
  ASSERT_TRUE(t->append_cycle(7, Values{1.5}));
  ASSERT_TRUE(t->finish());
  double progress = 0;
  const auto files = export_csv(folder, Existing::refuse, [&](double share) {
    EXPECT_GE(share, progress);
    progress = share;
  });
  ASSERT_TRUE(files) << files.error().message;
  EXPECT_THAT(*files, ElementsAre(folder / "telemetry.csv", folder / "cycles.csv"));
  EXPECT_EQ(progress, 1);
  EXPECT_EQ(text_of(folder / "cycles.csv"), "time_s,one.cycle_a\n7,1.5\n");
  std::ifstream csv(folder / "telemetry.csv");
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "time_s,one.a,one.b");
  for (std::size_t i = 0; i < 5000; ++i) {
    std::getline(csv, line);
    char* at = line.data();
    for (const double expected :
         {static_cast<double>(i) * 1e-3, odd[i % odd.size()], std::sin(static_cast<double>(i))}) {
      ASSERT_EQ(std::strtod(at, &at), expected) << line;
      if (*at == ',') ++at;
    }
  }
  EXPECT_FALSE(std::getline(csv, line));
}

TEST_F(TelemetryTest, ThreadsWriteTheirOwnRecords) {
  const auto work = [&](int id) {
    auto o = options({"one", "two"});
    o.wall_clock_s = nullptr;
    o.flush_interval_s = 0.01;
    auto t = Telemetry::create(folder / fmt::format("{}.h5", id), o);
    ASSERT_TRUE(t) << t.error().message;
    for (int i = 0; i < 20000; ++i) ASSERT_TRUE(t->append(i, Values{id + .0, id + .25, id + .5, id * 1e5 + i}));
    ASSERT_TRUE(t->finish());
  };
  {
    std::vector<std::jthread> threads;
    for (int id = 0; id < 4; ++id) threads.emplace_back(work, id);
  }
  for (int id = 0; id < 4; ++id) {
    const auto r = read_telemetry(folder / fmt::format("{}.h5", id));
    ASSERT_TRUE(r) << r.error().message;
    ASSERT_EQ(r->time_s.size(), 20000u);
    for (int i = 0; i < 20000; ++i) ASSERT_EQ(r->channel("two", "b")[i], id * 1e5 + i);
    EXPECT_EQ(r->channel("one", "a")[19999], id);
  }
}

// Debian's python, which has h5py where pip's may not; without h5py this fails.
TEST_F(TelemetryTest, H5pyReadsItFinishedAndRunning) {
  const auto python = [&](const char* state) {
    return std::system(fmt::format("/usr/bin/python3 '{}/tests/twin/io/telemetry/telemetry_h5py_test.py' '{}' {} 3000",
                                   TRIBOTWIN_SOURCE_DIR, file.string(), state)
                           .c_str());
  };
  auto o = options({"one", "/\u00fc"});
  o.joint_attributes = {{{"gear_ratio", 100}}, {{"gear_ratio", 178}}};
  auto t = Telemetry::create(file, o);
  ASSERT_TRUE(t) << t.error().message;
  ASSERT_TRUE(t->append_cycle(1, Values{1, 2}));
  for (int i = 0; i < 3000; ++i) {
    if (i == 2999) clock_s = 1;
    ASSERT_TRUE(t->append(i, Values{i + .0, i + .25, i + .5, i + .75}));
  }
  EXPECT_EQ(python("running"), 0);
  ASSERT_TRUE(t->finish());
  EXPECT_EQ(python("finished"), 0);
}

}  // namespace
}  // namespace tribotwin::twin
