// NumPy arrays and archives, MATLAB files: what is in them is read, what is wrong with them is said.
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <matio.h>
#include <sys/resource.h>
#include <unistd.h>
#include <zip.h>

#include <tribotwin/tests/twin/io/tables/table_files.hpp>
#include <tribotwin/twin/io/tables/numbers.hpp>

namespace tribotwin::twin {
namespace {

using testing::AllOf, testing::ElementsAre, testing::HasSubstr;
namespace fs = std::filesystem;

template <class T>
std::string bytes_of(const std::vector<double>& numbers, bool swapped = false) {
  std::string out;
  for (const double x : numbers) {
    const T value = static_cast<T>(x);
    std::string one(sizeof value, '\0');
    std::memcpy(one.data(), &value, sizeof value);
    if (swapped) std::reverse(one.begin(), one.end());
    out += one;
  }
  return out;
}

std::string npy(const std::string& dictionary, const std::string& data, int version = 1) {
  const std::size_t length = dictionary.size() + 1;
  std::string out = "\x93NUMPY";
  out += static_cast<char>(version);
  out += '\0';
  for (int i = 0; i < (version == 1 ? 2 : 4); ++i) out += static_cast<char>(length >> (8 * i) & 0xFF);
  return out + dictionary + "\n" + data;
}

std::string header(const std::string& type, const std::string& shape, bool fortran = false) {
  return "{'descr': " + type + ", 'fortran_order': " + (fortran ? "True" : "False") + ", 'shape': " + shape + ", }";
}

class Formats : public TableFiles {
 protected:
  /// An archive of arrays, deflated.
  fs::path archive(const std::string& name, const std::vector<std::pair<std::string, std::string>>& entries) {
    fs::remove(folder_ / name);
    zip_t* zip = zip_open((folder_ / name).c_str(), ZIP_CREATE, nullptr);
    for (const auto& [entry, bytes] : entries)
      zip_file_add(zip, entry.c_str(), zip_source_buffer(zip, bytes.data(), bytes.size(), 0), 0);
    EXPECT_EQ(zip_close(zip), 0);
    return folder_ / name;
  }
  /// time_s and q of a file, q being the column of that name.
  Result<Numbers> read(const fs::path& file, const std::string& time, const std::string& q) {
    const auto map = write("columns.yaml", "time_s: '" + time + "'\nposition_a_rad: '" + q + "'\n");
    return read_numbers(file, {"time_s", "position_a_rad"}, {.columns = map});
  }
  std::string refusal(const fs::path& file) {
    const auto table = read_numbers(file, {"time_s"});
    return table ? "was read" : table.error().message;
  }
};

TEST_F(Formats, NumpyNumbersOfEveryType) {
  const std::vector<double> q{0, 1, 2, 100};
  const struct {
    const char* type;
    std::string bytes;
  } cases[] = {{"'<f8'", bytes_of<double>(q)},
               {"'>f8'", bytes_of<double>(q, true)},
               {"'<f4'", bytes_of<float>(q)},
               {"'>f4'", bytes_of<float>(q, true)},
               {"'<i8'", bytes_of<std::int64_t>(q)},
               {"'>i4'", bytes_of<std::int32_t>(q, true)},
               {"'<i2'", bytes_of<std::int16_t>(q)},
               {"'|i1'", bytes_of<std::int8_t>(q)},
               {"'<u8'", bytes_of<std::uint64_t>(q)},
               {"'<u4'", bytes_of<std::uint32_t>(q)},
               {"'>u2'", bytes_of<std::uint16_t>(q, true)},
               {"'|u1'", bytes_of<std::uint8_t>(q)}};
  for (const auto& c : cases)
    for (const int version : {1, 2, 3}) {
      const auto file = archive("a.npz", {{"time_s.npy", npy(header("'<f8'", "(4,)"), bytes_of<double>({0, 1, 2, 3}))},
                                          {"position_a_deg.npy", npy(header(c.type, "(4,)"), c.bytes, version)}});
      const auto table = read_numbers(file, {"time_s", "position_a_rad"});
      ASSERT_TRUE(table) << c.type << table.error().message;
      for (std::size_t i = 0; i < q.size(); ++i)
        EXPECT_NEAR(table->columns[1][i], q[i] * std::acos(-1) / 180, 1e-15) << c.type << version;
    }
}

TEST_F(Formats, NumpyMatricesByColumnsAndRows) {
  const std::vector<double> rows{0, 10, 1, 11, 2, 12}, columns{0, 1, 2, 10, 11, 12};
  const struct {
    std::string bytes;
    const char *time, *q;
  } cases[] = {{npy(header("'<f8'", "(3, 2)"), bytes_of<double>(rows)), "[:,0]", "[:,1]"},
               {npy(header("'<f8'", "(3, 2)", true), bytes_of<double>(columns)), "[:,0]", "[:,1]"},
               {npy(header("'<f8'", "(2, 3)"), bytes_of<double>(columns)), "[0,:]", "[1,:]"},
               {npy(header("'<f8'", "(2, 3)", true), bytes_of<double>(rows)), "[0,:]", "[1,:]"},
               {npy(header("[('t', '<f8'), ('q', '<f8')]", "(3,)"), bytes_of<double>(rows)), "t", "q"},
               {npy(header("[('x', '<f8', (2,))]", "(3,)"), bytes_of<double>(rows)), "x[:,0]", "x[:,1]"},
               {npy(header("[('x', '<f8', 2)]", "(3L,)"), bytes_of<double>(rows)), "x[:,0]", "x[:,1]"}};
  for (const auto& c : cases) {
    const auto table = read(write("a.npy", c.bytes), c.time, c.q);
    ASSERT_TRUE(table) << c.q << table.error().message;
    EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 1, 2), ElementsAre(10, 11, 12))) << c.time;
  }
  // Fields that are named by the convention need no map; padding, texts and matrices of no interest are passed over.
  std::string item;
  for (int i = 0; i < 2; ++i) item += bytes_of<double>({0.5 * i}) + "abcd" + bytes_of<std::int16_t>({7.0 + i}) + "xy";
  const auto file =
      write("b.npy",
            npy(header("[('time_s', '<f8'), ('name', 'S4'), ('arm.position_rad', '<i2'), ('', '|V2')]", "(2,)"), item));
  const auto table = read_numbers(file, {"time_s", "position_arm_rad"});
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 0.5), ElementsAre(7, 8)));
}

TEST_F(Formats, NumpyThatIsWrongIsRefused) {
  const std::string f8 = bytes_of<double>({0, 1});
  const struct {
    const char* name;
    std::string bytes, says;
  } cases[] = {
      {"objects", npy(header("'|O'", "(2,)"), f8 + f8), "Python objects"},
      {"complex", npy(header("'<c16'", "(2,)"), f8 + f8), "'c16'"},
      {"half", npy(header("'<f2'", "(2,)"), f8), "accepted are f4, f8"},
      {"dates", npy(header("'<M8[ns]'", "(2,)"), f8), "'M8'"},
      {"cut off", npy(header("'<f8'", "(3,)"), f8), "cut off"},
      {"a shape beyond memory", npy(header("'<f8'", "(99999999999999999, 99999999999999999)"), f8), "memory"},
      {"a shape beyond the file", npy(header("'<f8'", "(999999999999,)"), f8), "cut off"},
      {"a negative shape", npy(header("'<f8'", "(-1,)"), f8), "not understood"},
      {"no shape", npy("{'descr': '<f8', 'fortran_order': False}", f8), "shape"},
      {"a call", npy("{'descr': __import__('os'), 'fortran_order': False, 'shape': (2,)}", f8), "not understood"},
      {"nested", npy(std::string(2000, '('), f8), "not understood"},
      {"version", npy(header("'<f8'", "(2,)"), f8, 4), "format 4"},
      {"a long header", std::string("\x93NUMPY\x02\x00\xff\xff\xff\x7f", 12), "header of"},
      {"cut off in the header", npy(header("'<f8'", "(2,)"), f8).substr(0, 20), "cut off in its header"},
      {"no array", "hello", "no NumPy array"},
      {"an escape", npy(header("'\x1b[2J'", "(2,)"), f8), "?[2J"},
  };
  for (const auto& c : cases) {
    const auto table = read(write("time_s.npy", c.bytes), "", "");
    const auto file = folder_ / "time_s.npy";
    // A plain array has no name: its only column is "".
    const auto map = write("rate.yaml", "time_s: {rate_hz: 1}\nposition_a_rad: x\n");
    std::string message = refusal(file);
    if (message == "was read")  // the header is fine; the numbers are not
      message = refusal(archive("a.npz", {{"time_s.npy", c.bytes}}));
    EXPECT_THAT(message, HasSubstr(c.says)) << c.name;
    EXPECT_THAT(refusal(archive("a.npz", {{"time_s.npy", c.bytes}})), HasSubstr(c.says)) << c.name;
  }
  EXPECT_THAT(refusal(write("a.npz", "PK\x03\x04 no archive")), HasSubstr("a.npz: is no readable .npz archive"));
  EXPECT_THAT(refusal(archive("b.npz", {{"data.pkl", "x"}})), HasSubstr("no array"));
  const auto lengths = archive("c.npz", {{"time_s.npy", npy(header("'<f8'", "(2,)"), f8)},
                                         {"position_a_rad.npy", npy(header("'<f8'", "(1,)"), f8)}});
  EXPECT_THAT(read_numbers(lengths, {"time_s", "position_a_rad"}).error().message,
              AllOf(HasSubstr("'position_a_rad' has 1 rows"), HasSubstr("'time_s' has 2")));
  const auto beyond = archive("d.npz", {{"time_s.npy", npy(header("'<f8'", "(2,)"), bytes_of<double>({0, 1e300}))}});
  EXPECT_THAT(refusal(beyond), AllOf(HasSubstr("row 2"), HasSubstr("'time_s'"), HasSubstr("within")));
}

TEST_F(Formats, RowsThatAreNotFiniteAreLeftOut) {
  const auto file =
      archive("a.npz", {{"time_s.npy", npy(header("'<f8'", "(4,)"), bytes_of<double>({0, 1, 2, 3}))},
                        {"torque_a_nm.npy", npy(header("'<f8'", "(4,)"), bytes_of<double>({5, NAN, INFINITY, 6}))}});
  const auto table = read_numbers(file, {"time_s", "torque_a_nm"});
  ASSERT_TRUE(table);
  EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 3), ElementsAre(5, 6)));
  EXPECT_EQ(table->left_out, 2u);
  EXPECT_EQ(table->first_left_out, 2u);
  EXPECT_EQ(table->row, "row");
}

matvar_t* matrix(const char* name, std::vector<double> numbers, std::size_t rows, std::size_t columns) {
  std::size_t dims[2] = {rows, columns};
  return Mat_VarCreate(name, MAT_C_DOUBLE, MAT_T_DOUBLE, 2, dims, numbers.data(), 0);
}

void add(mat_t* mat, matvar_t* variable) {
  EXPECT_EQ(Mat_VarWrite(mat, variable, MAT_COMPRESSION_ZLIB), 0);
  Mat_VarFree(variable);
}

/// A file of a vector, a matrix, integers, a struct with both, and what has no numbers.
void write_mat(const fs::path& file, mat_ft version) {
  mat_t* mat = Mat_CreateVer(file.c_str(), nullptr, version);
  ASSERT_TRUE(mat);
  add(mat, matrix("t", {0, 1, 2}, 1, 3));
  add(mat, matrix("Q", {0, 1, 2, 10, 11, 12}, 3, 2));
  std::size_t dims[2] = {3, 1};
  std::int16_t counts[3] = {10, 11, 12};
  add(mat, Mat_VarCreate("counts", MAT_C_INT16, MAT_T_INT16, 2, dims, counts, 0));
  char text[] = "hello";
  std::size_t letters[2] = {1, 5};
  add(mat, Mat_VarCreate("text", MAT_C_CHAR, MAT_T_UINT8, 2, letters, text, 0));
  const char* fields[] = {"time", "joint"};
  const char* inner[] = {"q"};
  std::size_t one[2] = {1, 1};
  matvar_t *data = Mat_VarCreateStruct("data", 2, one, fields, 2),
           *joint = Mat_VarCreateStruct("joint", 2, one, inner, 1);
  Mat_VarSetStructFieldByName(joint, "q", 0, matrix("q", {10, 11, 12}, 3, 1));
  Mat_VarSetStructFieldByName(data, "time", 0, matrix("time", {0, 1, 2}, 3, 1));
  Mat_VarSetStructFieldByName(data, "joint", 0, joint);
  add(mat, data);
  Mat_Close(mat);
}

TEST_F(Formats, MatlabVectorsMatricesAndStructs) {
  for (const mat_ft version : {MAT_FT_MAT5, MAT_FT_MAT73}) {
    write_mat(folder_ / "a.mat", version);
    for (const auto& [time, q] :
         {std::pair{"t", "Q(:,2)"}, {"Q(:,1)", "counts"}, {"data.time", "data.joint.q"}, {"t", "data.joint.q"}}) {
      const auto table = read(folder_ / "a.mat", time, q);
      ASSERT_TRUE(table) << version << q << table.error().message;
      EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 1, 2), ElementsAre(10, 11, 12))) << version << q;
    }
    EXPECT_THAT(read(folder_ / "a.mat", "t", "text").error().message,
                AllOf(HasSubstr("'text'"), HasSubstr("Q(:,1), Q(:,2)"), HasSubstr("data.joint.q"), HasSubstr("a.mat")));
    EXPECT_THAT(read(folder_ / "a.mat", "t", "Q(1,:)").error().message, HasSubstr("has 2 rows"));
  }
}

TEST_F(Formats, MatlabThatIsWrongIsRefused) {
  EXPECT_THAT(refusal(write("a.mat", "")), HasSubstr("a.mat"));
  EXPECT_THAT(refusal(write("a.mat", "MATLAB 5.0 MAT-file")), HasSubstr("a.mat"));
  EXPECT_THAT(refusal(folder_ / "none.mat"), HasSubstr("none.mat"));
  // A matrix that promises more than its file can hold takes no memory. Its dimensions are at the place of 3 x 2.
  mat_t* mat = Mat_CreateVer((folder_ / "b.mat").c_str(), nullptr, MAT_FT_MAT5);
  matvar_t* q = matrix("q", {0, 1, 2, 10, 11, 12}, 3, 2);
  Mat_VarWrite(mat, q, MAT_COMPRESSION_NONE);
  Mat_VarFree(q);
  Mat_Close(mat);
  std::ifstream stream(folder_ / "b.mat", std::ios::binary);
  std::string bytes(std::istreambuf_iterator<char>(stream), {});
  const std::string dims = bytes_of<std::int32_t>({3, 2});
  const auto at = bytes.find(dims);
  ASSERT_NE(at, bytes.npos);
  for (const auto& [rows, says] : {std::pair{1e8, "promises"}, {1.5e9, "longer than"}}) {
    std::string changed = bytes;
    changed.replace(at, dims.size(), bytes_of<std::int32_t>({rows, 2}));
    EXPECT_THAT(read(write("c.mat", changed), "q(:,1)", "q(:,2)").error().message, HasSubstr(says)) << rows;
  }
}

/// A list of so many cells: libmatio takes memory for each.
TEST_F(Formats, MatlabThatPromisesCellsTakesNoMemory) {
  const auto words = [](std::initializer_list<std::uint32_t> all) {
    return std::string(reinterpret_cast<const char*>(all.begin()), all.size() * sizeof(std::uint32_t));
  };
  constexpr std::uint32_t matrix_type = 14, cells_class = 1;
  std::string mat = "MATLAB 5.0 MAT-file" + std::string(105, ' ') + std::string("\x00\x01IM", 4);
  mat += words({matrix_type, 48, 6, 8, cells_class, 0, 5, 8, 1U << 27, 1, 1, 1, 'c', 0});
  EXPECT_THAT(refusal(write("cells.mat", mat)), AllOf(HasSubstr("cells.mat"), HasSubstr("wants memory without end")));
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  EXPECT_LT(usage.ru_maxrss, 512 * 1024) << "KiB";
}

/// libmatio gives what is before the cut, and says nothing.
TEST_F(Formats, MatlabFilesThatAreCutOffAreRefused) {
  for (const mat_ft version : {MAT_FT_MAT4, MAT_FT_MAT5, MAT_FT_MAT73})
    for (const auto compression : {MAT_COMPRESSION_NONE, MAT_COMPRESSION_ZLIB}) {
      if (version == MAT_FT_MAT4 && compression == MAT_COMPRESSION_ZLIB) continue;
      mat_t* mat = Mat_CreateVer((folder_ / "a.mat").c_str(), nullptr, version);
      for (const char* name : {"time_s", "torque_a_nm", "z"}) {
        matvar_t* v = matrix(name, {0, 1, 2, 3.5, 7, 9}, 6, 1);
        ASSERT_EQ(Mat_VarWrite(mat, v, compression), 0);
        Mat_VarFree(v);
      }
      Mat_Close(mat);
      EXPECT_TRUE(read_numbers(folder_ / "a.mat", {"time_s", "torque_a_nm"})) << version;
      std::ifstream stream(folder_ / "a.mat", std::ios::binary);
      const std::string bytes(std::istreambuf_iterator<char>(stream), {});
      for (const std::size_t lost : {1, 4, 20}) {
        const auto table =
            read_numbers(write("cut.mat", bytes.substr(0, bytes.size() - lost)), {"time_s", "torque_a_nm"});
        ASSERT_FALSE(table) << version << " without its last " << lost;
        if (version != MAT_FT_MAT73) EXPECT_THAT(table.error().message, HasSubstr("cut.mat: is cut off or damaged"));
      }
    }
}

TEST_F(Formats, ArraysWithSidesOfOneAreVectorsAndMatrices) {
  const std::string three = bytes_of<double>({1, 2, 3}), six = bytes_of<double>({0, 10, 1, 11, 2, 12});
  for (const auto& [shape, column] : {std::pair{"(3, 1, 1)", "q"}, {"(1, 3, 1)", "q"}, {"(1, 1, 3)", "q"}}) {
    const auto table = read(archive("a.npz", {{"t.npy", npy(header("'<f8'", "(3,)"), three)},
                                              {"q.npy", npy(header("'<f8'", shape), three)}}),
                            "t", column);
    ASSERT_TRUE(table) << shape << table.error().message;
    EXPECT_THAT(table->columns[1], ElementsAre(1, 2, 3)) << shape;
  }
  for (const char* shape : {"(3, 1, 2)", "(3, 2, 1)", "(1, 3, 2)"}) {
    const auto table = read(write("a.npy", npy(header("'<f8'", shape), six)), "[:,0]", "[:,1]");
    ASSERT_TRUE(table) << shape << table.error().message;
    EXPECT_THAT(table->columns, ElementsAre(ElementsAre(0, 1, 2), ElementsAre(10, 11, 12))) << shape;
  }
  const auto cube = archive("b.npz", {{"t.npy", npy(header("'<f8'", "(3,)"), three)},
                                      {"q.npy", npy(header("'<f8'", "(3, 2, 2)"), six + six)}});
  EXPECT_THAT(read(cube, "t", "q").error().message, AllOf(HasSubstr("'q'"), HasSubstr("3 dimensions, 3 x 2 x 2")));
  for (const mat_ft version : {MAT_FT_MAT5, MAT_FT_MAT73}) {
    mat_t* mat = Mat_CreateVer((folder_ / "a.mat").c_str(), nullptr, version);
    double numbers[] = {0, 1, 2, 10, 11, 12, 5, 6, 7, 8, 9, 10};
    std::size_t flat[] = {3, 1, 2}, deep[] = {3, 2, 2};
    add(mat, matrix("t", {0, 1, 2}, 3, 1));
    add(mat, Mat_VarCreate("Q", MAT_C_DOUBLE, MAT_T_DOUBLE, 3, flat, numbers, 0));
    add(mat, Mat_VarCreate("R", MAT_C_DOUBLE, MAT_T_DOUBLE, 3, deep, numbers, 0));
    Mat_Close(mat);
    const auto table = read(folder_ / "a.mat", "t", "Q(:,2)");
    ASSERT_TRUE(table) << version << table.error().message;
    EXPECT_THAT(table->columns[1], ElementsAre(10, 11, 12));
    EXPECT_THAT(read(folder_ / "a.mat", "t", "R").error().message, HasSubstr("3 dimensions, 3 x 2 x 2")) << version;
  }
}

/// Damaged files end in a message or in numbers, never in a crash.
TEST_F(Formats, DamageIsSurvived) {
  write_mat(folder_ / "a.mat", MAT_FT_MAT5);
  const auto npz =
      archive("a.npz", {{"time_s.npy", npy(header("'<f8'", "(3,)"), bytes_of<double>({0, 1, 2}))},
                        {"x.npy", npy(header("[('q', '<f8', (2,)), ('n', 'S3')]", "(1,)"), std::string(19, 'x'))}});
  const auto npy_file =
      write("a.npy", npy(header("[('time_s', '<f8'), ('q', '<f8', (2,))]", "(2,)"), std::string(48, 'x')));
  std::mt19937_64 random(1);
  std::size_t read_ones = 0, tries = 0;
  for (const auto& file : {folder_ / "a.mat", npz, npy_file}) {
    std::ifstream stream(file, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(stream), {});
    const int rounds = file.extension() == ".mat" ? 60 : 1500;
    for (int round = 0; round < rounds; ++round, ++tries) {
      std::string changed = bytes;
      for (int k = 0; k < 1 + round % 4; ++k) changed[random() % changed.size()] = static_cast<char>(random());
      if (round % 5 == 0) changed.resize(random() % changed.size());
      const auto damaged = write("damaged" + file.extension().string(), changed);
      read_ones += read_numbers(damaged, {"time_s"}).has_value();
      const auto mapped =
          read(damaged, file.extension() == ".mat" ? "t" : "time_s", file.extension() == ".mat" ? "Q(:,1)" : "q[:,0]");
      if (!mapped) EXPECT_FALSE(mapped.error().message.empty());
      if (!mapped)
        EXPECT_EQ(std::ranges::count_if(mapped.error().message, [](char c) { return c < 0x20 || c > 0x7E; }), 0)
            << mapped.error().message;
    }
  }
  EXPECT_GT(read_ones, 0u);
  EXPECT_LT(read_ones, tries);
}

}  // namespace
}  // namespace tribotwin::twin
