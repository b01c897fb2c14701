#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>
#include <libpq-fe.h>
#include <pqxx/pqxx>

#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/io/input.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr std::int64_t version = 1;
constexpr const char* marker = "tribotwin_fleet";  ///< table with the version of the others
constexpr int lock = 0x54424654;                   ///< "TBFT": first half of the advisory lock's key

std::string replaced(std::string text, std::string_view what, std::string_view with) {
  for (std::size_t at = 0; (at = text.find(what, at)) != text.npos; at += with.size())
    text.replace(at, what.size(), with);
  return text;
}

/// In the words of PostgreSQL; text is compared by bytes, as in SQLite.
std::string of_postgresql(std::string schema) {
  schema = replaced(std::move(schema), " INTEGER", " BIGINT");
  schema = replaced(std::move(schema), " REAL", " DOUBLE PRECISION");
  schema = replaced(std::move(schema), " TEXT", " TEXT COLLATE \"C\"");
  return replaced(std::move(schema), " WITHOUT ROWID", "");
}

/// The message of the server or of libpq on one line, without the statement that it quotes.
std::string why(const std::string& url, const std::exception& e) {
  std::string text = e.what();
  if (const auto quoted = text.find("\nLINE "); quoted != text.npos) text.erase(quoted);
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  return fmt::format("{}: {}", without_password(url), replaced(replaced(std::move(text), "\n\t", " "), "\n", "; "));
}

/// Of what the server says: a constraint of theirs is violated, or they lack what a statement names.
bool of_other_tables(std::string_view sqlstate) {
  constexpr std::string_view no_permission = "42501";
  return sqlstate.starts_with("23") || (sqlstate.starts_with("42") && sqlstate != no_permission);
}

/// Work on the database, with errors as this program says them.
template <class F>
auto said(const std::string& url, const F& work) {
  try {
    return work();
  } catch (const pqxx::in_doubt_error&) {
    throw std::runtime_error(
        fmt::format("{}: the connection was lost while the store was written, which has all or nothing of this "
                    "command; run it again",
                    without_password(url)));
  } catch (const pqxx::data_exception& e) {
    throw InputError(why(url, e));
  } catch (const pqxx::sql_error& e) {
    if (!of_other_tables(e.sqlstate())) throw std::runtime_error(why(url, e));
    throw InputError(fmt::format("{}; its tables are not those of a store of tribotwin fleet", why(url, e)));
  } catch (const pqxx::failure& e) {
    throw std::runtime_error(why(url, e));
  }
}

class PostgresqlStatement : public Statement {
 public:
  PostgresqlStatement(const std::string& url, pqxx::work& work, const std::string& name)
      : url_(url), work_(work), name_(name) {}

  bool row() override {
    if (!result_) {
      std::vector<const char*> values;
      for (const auto& v : values_) values.push_back(v ? v->c_str() : nullptr);
      result_ = said(url_, [&] { return work_.exec_prepared(name_, pqxx::prepare::make_dynamic_params(values)); });
      at_ = -1;
    }
    return ++at_ < static_cast<int>(result_->size());
  }
  std::int64_t integer(int column) const override { return number<std::int64_t>(column, 0); }
  double real(int column) const override { return number(column, std::numeric_limits<double>::quiet_NaN()); }
  std::string text(int column) const override {
    const auto field = (*result_)[at_][column];
    return field.is_null() ? std::string() : std::string(field.c_str(), field.size());
  }

 private:
  void reset() override { values_.clear(), result_.reset(); }
  void put(int at, std::optional<std::string> x) {
    values_.resize(static_cast<std::size_t>(at));
    values_.back() = std::move(x);
  }
  void bind(int at, std::int64_t x) override { put(at, fmt::format("{}", x)); }
  void bind(int at, double x) override {
    // The shortest text that reads back as the same number.
    std::isfinite(x) ? put(at, fmt::format("{}", x)) : put(at, std::nullopt);
  }
  void bind(int at, const std::string& x) override {
    if (x.find('\0') != x.npos)
      throw InputError(fmt::format("{}: text with a zero byte cannot be kept", without_password(url_)));
    put(at, x);
  }
  template <class T>
  T number(int column, T none) const {
    const auto field = (*result_)[at_][column];
    if (field.is_null()) return none;
    T x{};
    const char* end = field.c_str() + field.size();
    if (const auto [read, error] = std::from_chars(field.c_str(), end, x); error != std::errc{} || read != end)
      throw std::runtime_error(fmt::format("{}: '{}' is not a number", without_password(url_), field.c_str()));
    return x;
  }

  const std::string& url_;
  pqxx::work& work_;
  const std::string name_;
  std::vector<std::optional<std::string>> values_;
  std::optional<pqxx::result> result_;
  int at_ = -1;
};

/// A password with an @ or / of its own could end up in the name of a host, and so in messages of libpq.
void require_readable(const std::string& url) {
  const auto user = url.find("://") + 3, colon = url.find(':', user), at = url.rfind('@');
  const bool clear = at == url.npos || colon == url.npos || colon > at ||
                     url.substr(user, at - user).find_first_of("@/?#") == url.npos;
  char* message = nullptr;
  auto* options = clear ? PQconninfoParse(url.c_str(), &message) : nullptr;
  bool read = options;
  for (auto* o = options; o && o->keyword; ++o)  // libpq looks at a port only when it connects
    if (std::string_view(o->keyword) == "port" && o->val)
      read = read && std::string_view(o->val).find_first_not_of("0123456789,") == std::string_view::npos;
  PQconninfoFree(options);
  PQfreemem(message);  // it may quote the whole URL
  if (!read)
    throw InputError(fmt::format(
        "{}: is no URL of a database; write postgresql://USER@HOST:PORT/DATABASE, with %40 for @ and %2F for / in a "
        "name; the password belongs in PGPASSWORD or ~/.pgpass",
        without_password(url)));
}

class Postgresql : public Database {
 public:
  Postgresql(const std::string& url, const char* schema) : url_(url) {
    require_readable(url);
    said(url_, [&] {
      connection_ = std::make_unique<pqxx::connection>(url);
      connection_->set_client_encoding("UTF8");
      work_ = std::make_unique<pqxx::work>(*connection_);
      begin(schema);
    });
  }
  ~Postgresql() override { forget_statements(); }

  void commit() override {
    said(url_, [&] { work_->commit(); });
  }
  void add_column(const std::string& table, const std::string& column) override {
    // Only the owner of a table may alter it, even to no effect.
    said(url_, [&] {
      const auto known = work_->exec(
          fmt::format("SELECT 1 FROM information_schema.columns WHERE table_schema = current_schema() AND table_name = "
                      "{} AND column_name = {}",
                      work_->quote(table), work_->quote(column)));
      if (known.empty()) work_->exec(fmt::format("ALTER TABLE {} ADD COLUMN {} DOUBLE PRECISION", table, column));
    });
  }

 private:
  std::unique_ptr<Statement> prepare(const char* sql) override {
    const std::string name = fmt::format("s{}", ++prepared_);
    said(url_, [&] { connection_->prepare(name, sql); });
    return std::make_unique<PostgresqlStatement>(url_, *work_, name);
  }
  /// The lock, then the tables: of this program, or made now.
  void begin(const char* schema) {
    work_->exec("SET TRANSACTION ISOLATION LEVEL READ COMMITTED");
    work_->exec(
        "SET LOCAL client_min_messages = error; SET LOCAL extra_float_digits = 3; SET LOCAL lock_timeout = '10s'");
    const auto current = work_->exec1("SELECT current_schema()")[0];
    if (current.is_null())
      throw InputError(
          fmt::format("{}: there is no schema to keep tables in; set search_path", without_password(url_)));
    const std::string name = current.c_str();
    // Tables of the same names in other schemas are not meant.
    work_->exec("SET LOCAL search_path = " + work_->quote_name(name));
    try {
      work_->exec(fmt::format("SELECT pg_advisory_xact_lock({}, hashtext(current_schema()))", lock));
    } catch (const pqxx::sql_error& e) {
      if (e.sqlstate() != "55P03") throw;
      throw std::runtime_error(fmt::format(
          "{}: another command works on this store, for more than 10 s; try again later", without_password(url_)));
    }
    if (has(name, marker)) return require_version(name);
    const std::string tables = of_postgresql(schema);
    static constexpr std::string_view create = "CREATE TABLE ";
    for (std::size_t at = 0; (at = tables.find(create, at)) != tables.npos;) {
      at += create.size();
      if (const auto table = tables.substr(at, tables.find('(', at) - at); has(name, table))
        throw InputError(
            fmt::format("{}: schema {} has a table '{}' that is not of tribotwin fleet; nothing was "
                        "changed; name another database, or another schema by ?options=-csearch_path%3DNAME",
                        without_password(url_), name, table));
    }
    work_->exec(tables);
    work_->exec(
        fmt::format("CREATE TABLE {}(version BIGINT NOT NULL); INSERT INTO {} VALUES({})", marker, marker, version));
  }
  bool has(const std::string& schema, const std::string& table) {
    return !work_
                ->exec(fmt::format("SELECT 1 FROM pg_catalog.pg_class c JOIN pg_catalog.pg_namespace n ON n.oid = "
                                   "c.relnamespace WHERE n.nspname = {} AND c.relname = {}",
                                   work_->quote(schema), work_->quote(table)))
                .empty();
  }
  void require_version(const std::string& schema) {
    std::string found = "none";
    try {
      const auto rows = work_->exec(fmt::format("SELECT version FROM {}", marker));
      if (rows.size() == 1 && !rows[0][0].is_null()) found = rows[0][0].c_str();
    } catch (const pqxx::sql_error& e) {
      if (e.sqlstate() != "42703") throw;  // no such column
    }
    if (found != fmt::format("{}", version))
      throw InputError(
          fmt::format("{}: table {}.{} has version {} and not {}: of something else, or of another "
                      "tribotwin; nothing was changed",
                      without_password(url_), schema, marker, found, version));
  }

  const std::string url_;
  int prepared_ = 0;
  std::unique_ptr<pqxx::connection> connection_;
  std::unique_ptr<pqxx::work> work_;
};

}  // namespace

std::unique_ptr<Database> open_postgresql(const std::string& url, const char* schema) {
  return std::make_unique<Postgresql>(url, schema);
}

}  // namespace tribotwin::twin::diagnosis::fleet
