# Targets carry their flags: nothing here is global. A room is a static library; what it may use, it links.

# With the checks of a sanitizer, -O2 takes twice the time of -O1 to compile.
set(optimize -O2)
if(HORD_SANITIZE)
  set(optimize -O1)
endif()
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "${optimize} -g1 -DNDEBUG")
set(CMAKE_C_FLAGS_RELWITHDEBINFO "${optimize} -g1 -DNDEBUG")

find_program(CCACHE ccache)
if(CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # The sloppiness is what ccache asks for with precompiled headers.
  set(launcher ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE})
  set(CMAKE_C_COMPILER_LAUNCHER ${launcher})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${launcher})
endif()
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
find_package(Threads REQUIRED)

add_library(hord_flags INTERFACE)
target_compile_features(hord_flags INTERFACE cxx_std_20)
target_compile_options(hord_flags INTERFACE -Wall -Wextra -Wpedantic -Wconversion -Wshadow -ffp-contract=off
                       $<$<BOOL:${HORD_WERROR}>:-Werror>)
target_compile_definitions(hord_flags INTERFACE $<$<BOOL:${HORD_CHECKED}>:HORD_CHECKED=1>)
target_include_directories(hord_flags INTERFACE ${PROJECT_SOURCE_DIR})
target_link_options(hord_flags INTERFACE -Wl,--as-needed)  # a program needs only the libraries that it calls
if(HORD_SANITIZE)
  # GCC's null checks make the address of a function no constant: the register table's static_asserts would not compile.
  target_compile_options(hord_flags INTERFACE -fsanitize=${HORD_SANITIZE} -fno-sanitize=null,nonnull-attribute,returns-nonnull-attribute)
  target_compile_options(hord_flags INTERFACE -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(hord_flags INTERFACE -fsanitize=${HORD_SANITIZE})
endif()

# Every folder with sources is one target and every target is one folder: the target of firmware/core is hord_firmware_core.
# hord_targets(OUT firmware/core fmt::fmt ...): folders become their targets; names with :: stay.
function(hord_targets out)
  set(targets)
  foreach(name ${ARGN})
    if(name MATCHES "/|^common$")
      string(REPLACE "/" "_" name "hord_${name}")
    endif()
    list(APPEND targets ${name})
  endforeach()
  set(${out} ${targets} PARENT_SCOPE)
endfunction()

# hord_room([UNITY] SOURCES a.cpp ... USES folder-or-target ... PRIVATELY folder-or-target ...): the library of this
# folder; sets `room` to its target.
#   USES      appears in the room's own headers; PRIVATELY stays inside its .cpp files.
#   UNITY     compiles up to eight files as one: for folders whose files all include a heavy library (CLI11, nlohmann-json,
#             OpenCV), where that takes a third of the time. Anonymous namespaces must not define the same name twice.
option(HORD_UNITY "Compile the files of folders marked UNITY together" ON)
function(hord_room)
  cmake_parse_arguments(ROOM "UNITY" "" "SOURCES;USES;PRIVATELY" ${ARGN})
  file(RELATIVE_PATH folder ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
  string(REPLACE "/" "_" name "hord_${folder}")
  hord_targets(uses ${ROOM_USES})
  hord_targets(privately ${ROOM_PRIVATELY})
  if(ROOM_SOURCES)
    add_library(${name} STATIC ${ROOM_SOURCES})
    target_link_libraries(${name} PUBLIC hord_flags ${uses} PRIVATE ${privately})
    if(ROOM_UNITY AND HORD_UNITY)
      set_target_properties(${name} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
    endif()
  else()  # headers alone
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE hord_flags ${uses} ${privately})
  endif()
  set(room ${name} PARENT_SCOPE)
endfunction()

# hord_program(NAME [UNITY] SOURCES ... USES folder-or-target ...): an executable in build/<preset>/bin.
function(hord_program name)
  cmake_parse_arguments(PROGRAM "UNITY" "" "SOURCES;USES" ${ARGN})
  add_executable(${name} ${PROGRAM_SOURCES})
  if(PROGRAM_UNITY AND HORD_UNITY)
    set_target_properties(${name} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  endif()
  hord_targets(uses ${PROGRAM_USES})
  target_link_libraries(${name} PRIVATE hord_flags ${uses})
  target_compile_definitions(${name} PRIVATE HORD_VERSION="${PROJECT_VERSION}")
endfunction()

# hord_module(NAME FOLDER folder SOURCES ... USES folder-or-target ...): a Python extension, FOLDER/NAME.*.so below
# build/<preset>/python. The libraries of this tree that it links become position independent, and only those: hidden
# names without interposition compile to the same code as in a program.
function(hord_module name)
  cmake_parse_arguments(MODULE "" "FOLDER" "SOURCES;USES" ${ARGN})
  hord_targets(uses ${MODULE_USES})
  pybind11_add_module(${name} MODULE NO_EXTRAS ${MODULE_SOURCES})
  target_link_libraries(${name} PRIVATE hord_flags ${uses})
  target_compile_definitions(${name} PRIVATE HORD_VERSION="${PROJECT_VERSION}")
  set_target_properties(${name} PROPERTIES CXX_VISIBILITY_PRESET hidden
                        LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/python/${MODULE_FOLDER})
  target_link_options(${name} PRIVATE -Wl,--exclude-libs,ALL)
  set(left ${uses})
  set(seen)
  while(left)
    list(POP_FRONT left one)
    string(REGEX REPLACE "^\\$<LINK_ONLY:(.*)>$" "\\1" one "${one}")
    if(one IN_LIST seen OR NOT one MATCHES "^hord_" OR NOT TARGET ${one})
      continue()
    endif()
    list(APPEND seen ${one})
    get_target_property(kind ${one} TYPE)
    get_target_property(links ${one} INTERFACE_LINK_LIBRARIES)
    if(links)
      list(APPEND left ${links})
    endif()
    if(kind STREQUAL STATIC_LIBRARY)
      set_target_properties(${one} PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden)
      target_compile_options(${one} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-fno-semantic-interposition>)
    endif()
  endwhile()
endfunction()
