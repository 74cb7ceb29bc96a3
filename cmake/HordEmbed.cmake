# hord_embed(OUT.cpp FUNCTION name HEADER path [PREFIX text] FOLDER path FILES a.md ... [PARTS b.html ...]): generates OUT.cpp in the build
# folder at build time. It defines `std::span<const EmbeddedFile> name()` (common/embedded_file.h), the content of FILES
# in FOLDER as bytes. `name` is qualified (hord::...) and declared in HEADER; each path is PREFIX and the file's name.
# A line "<!-- include b.html -->" is replaced by that file of PARTS.
# The function runs when CMake configures; the rest of this file is the generator, which runs when the files change.
if(NOT CMAKE_SCRIPT_MODE_FILE)
  function(hord_embed out)
    cmake_parse_arguments(EMBED "" "FUNCTION;HEADER;PREFIX;FOLDER" "FILES;PARTS" ${ARGN})
    list(TRANSFORM EMBED_FILES PREPEND ${EMBED_FOLDER}/ OUTPUT_VARIABLE paths)
    list(TRANSFORM EMBED_PARTS PREPEND ${EMBED_FOLDER}/ OUTPUT_VARIABLE parts)
    add_custom_command(
      OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${out}
      COMMAND ${CMAKE_COMMAND} -DOUT=${CMAKE_CURRENT_BINARY_DIR}/${out} -DFUNCTION=${EMBED_FUNCTION}
              -DHEADER=${EMBED_HEADER} -DPREFIX=${EMBED_PREFIX} -DFOLDER=${EMBED_FOLDER} "-DFILES=${EMBED_FILES}" "-DPARTS=${EMBED_PARTS}"
              -P ${PROJECT_SOURCE_DIR}/cmake/HordEmbed.cmake
      DEPENDS ${paths} ${parts} ${PROJECT_SOURCE_DIR}/cmake/HordEmbed.cmake VERBATIM)
  endfunction()
  return()
endif()

set(type_html "text/html; charset=utf-8")
set(type_css "text/css; charset=utf-8")
set(type_js "text/javascript; charset=utf-8")
set(type_md "text/markdown; charset=utf-8")
set(type_svg "image/svg+xml")
set(arrays "")
set(rows "")
set(k 0)
foreach(file ${FILES})
  file(READ ${FOLDER}/${file} hex HEX)
  foreach(part ${PARTS})
    file(READ ${FOLDER}/${part} part_hex HEX)
    string(HEX "<!-- include ${part} -->\n" line)
    string(REPLACE "${line}" "${part_hex}" hex "${hex}")
  endforeach()
  string(LENGTH "${hex}" size)
  math(EXPR size "${size} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${hex}")
  string(REGEX REPLACE "^.*\\." "" ending ${file})
  string(APPEND arrays "constexpr unsigned char k${k}[] = {${bytes}};\n")
  string(APPEND rows "    {\"${PREFIX}${file}\", \"${type_${ending}}\", {reinterpret_cast<const char*>(k${k}), ${size}}},\n")
  math(EXPR k "${k} + 1")
endforeach()
file(WRITE ${OUT} "// Generated from ${FILES}\n#include \"${HEADER}\"\n\nnamespace {\n${arrays}"
  "const hord::EmbeddedFile kFiles[] = {\n${rows}};\n}\nstd::span<const hord::EmbeddedFile> ${FUNCTION}() { return kFiles; }\n")
