# Targets carry their flags: nothing here is global. A room is a static library; what it may use, it links.

set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g1 -DNDEBUG")
set(CMAKE_C_FLAGS_RELWITHDEBINFO "-O2 -g1 -DNDEBUG")

find_program(CCACHE ccache)
if(CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_C_COMPILER_LAUNCHER ${CCACHE})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE})
endif()
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
find_package(Threads REQUIRED)

add_library(hord_flags INTERFACE)
target_compile_features(hord_flags INTERFACE cxx_std_20)
target_compile_options(hord_flags INTERFACE -Wall -Wextra -Wpedantic -Wconversion -Wshadow -ffp-contract=off
                       $<$<BOOL:${HORD_WERROR}>:-Werror>)
target_compile_definitions(hord_flags INTERFACE $<$<BOOL:${HORD_CHECKED}>:HORD_CHECKED=1>)
target_include_directories(hord_flags INTERFACE ${PROJECT_SOURCE_DIR})
if(HORD_SANITIZE)
  # GCC's null checks make the address of a function no constant: the register table's static_asserts would not compile.
  target_compile_options(hord_flags INTERFACE -fsanitize=${HORD_SANITIZE} -fno-sanitize=null,nonnull-attribute,returns-nonnull-attribute)
  target_compile_options(hord_flags INTERFACE -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(hord_flags INTERFACE -fsanitize=${HORD_SANITIZE})
endif()

# hord_room(NAME SOURCES a.cpp ... USES target ... PRIVATELY target ...)
#   USES      appears in the room's own headers; PRIVATELY stays inside its .cpp files.
function(hord_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;USES;PRIVATELY" ${ARGN})
  add_library(${name} STATIC ${ROOM_SOURCES})
  target_link_libraries(${name} PUBLIC hord_flags ${ROOM_USES} PRIVATE ${ROOM_PRIVATELY})
endfunction()

# hord_program(NAME SOURCES ... USES ...): an executable in build/<preset>/bin.
function(hord_program name)
  cmake_parse_arguments(PROGRAM "" "" "SOURCES;USES" ${ARGN})
  add_executable(${name} ${PROGRAM_SOURCES})
  target_link_libraries(${name} PRIVATE hord_flags ${PROGRAM_USES})
endfunction()
