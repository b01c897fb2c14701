#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include <pugixml.hpp>

#include <tribotwin/plugins/drive/drive.hpp>
#include <tribotwin/plugins/friction/error.hpp>

/// The text of a model: its files as the user wrote them, so that every message can say file and line.
namespace tribotwin::mujoco {

/// One file of a model, its includes not yet merged: line numbers are those the user sees.
struct Source {
  std::string name;  // for messages
  std::string text;
  std::unique_ptr<pugi::xml_document> document = std::make_unique<pugi::xml_document>();
  std::vector<std::ptrdiff_t> breaks;  ///< line feeds before each block of the text, so that line() is quick

  /// Of a place in the text, from 1.
  std::ptrdiff_t line(std::ptrdiff_t offset) const;
};

/// FILE:LINE: <ELEMENT name="...">
std::string at(const Source& source, pugi::xml_node element);

Result<std::string> read_text(const std::filesystem::path& file);

/// The files of a model, main file first. Fails on text that is no XML, on elements nested too deep and on impossible
/// numbers that no engine checks.
Result<std::vector<Source>> read_sources(std::string name, std::string text, const std::filesystem::path& folder);

/// Fails on unknown elements, attributes and text in <extension>, because engine 2.2.2 sees none of them.
Result<void> check_extensions(const std::vector<Source>& sources);

/// A message of the engine without line and column.
std::string without_position(const std::string& message);

/// Where the elements of a text that the engine reads come from.
class Origins {
 public:
  /// For a text that is the user's own.
  explicit Origins(const std::vector<Source>& sources);
  /// `copy` of an element, its children included, was made from `original` of `source`.
  void add_copy(const Source& source, pugi::xml_node original, pugi::xml_node copy);
  /// From now on lines refer to `text`, the saved form of `document`.
  void saved_as(const std::string& text, const pugi::xml_document& document);
  /// A message of the engine on one line, with the user's file and line in place of the engine's; else with `name`.
  std::string located(std::string message, const std::string& name) const;

 private:
  struct Place {
    const Source* source;
    std::ptrdiff_t offset;
  };
  struct Line {
    std::ptrdiff_t number;
    std::string element;
    Place place;
  };
  const Source* main_;
  std::unordered_map<std::size_t, Place> copies_;  ///< by hash of the node
  std::vector<Line> lines_;
};

/// Replaces every <include> in the main file by the content of its file. `origins` learns where the copies come from.
void merge_includes(const std::vector<Source>& sources, const std::filesystem::path& folder,
                    Origins* origins = nullptr);

/// Removes the declarations of our plugins.
void remove_extensions(pugi::xml_document& document);

/// Turns the actuator of a drive into the engine's own: a motor, or for a position control a servo.
void make_native(pugi::xml_node actuator, const drive::Drive& drive);

/// Folders of meshes and textures become absolute, for a text that no longer lies in `folder`.
void make_asset_folders_absolute(pugi::xml_document& document, const std::filesystem::path& folder);

/// One element per line, indented by two blanks. Throws std::bad_alloc, which pugixml's writer to a stream would
/// swallow: the text would end early. `format`: pugixml's flags.
std::string text_of(const pugi::xml_document& document, unsigned format = pugi::format_default);

/// The text of a model's main file with its includes merged.
Result<std::unique_ptr<pugi::xml_document>> load_merged(const std::filesystem::path& file);

}  // namespace tribotwin::mujoco
