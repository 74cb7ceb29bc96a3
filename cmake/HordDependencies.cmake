# Debian's packages as targets. Each is linked only by the file that calls it (PRIVATELY), so that no room
# inherits another's library.

find_package(PkgConfig REQUIRED)

# tl::expected and CLI11 are header-only and in the default include path.
find_path(HORD_EXPECTED_DIR tl/expected.hpp REQUIRED)

# Only OpenCV's core and imgproc are installed (imgcodecs for the tests); OpenCVConfig.cmake wants all of OpenCV.
find_path(HORD_OPENCV_INCLUDE opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
set(parts core imgproc)
if(HORD_TESTS)
  list(APPEND parts imgcodecs)  # reads and writes images as others do; it brings some 130 libraries
endif()
foreach(part ${parts})
  find_library(HORD_OPENCV_${part} opencv_${part} REQUIRED)
  add_library(opencv::${part} INTERFACE IMPORTED)
  target_include_directories(opencv::${part} SYSTEM INTERFACE ${HORD_OPENCV_INCLUDE})
  target_link_libraries(opencv::${part} INTERFACE ${HORD_OPENCV_${part}} ${HORD_OPENCV_core})
endforeach()

find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(Ceres REQUIRED)
find_package(tomlplusplus REQUIRED)
pkg_check_modules(modbus REQUIRED IMPORTED_TARGET libmodbus)
pkg_check_modules(gpiod REQUIRED IMPORTED_TARGET libgpiod)
pkg_check_modules(libcamera IMPORTED_TARGET libcamera)
if(NOT libcamera_FOUND)
  message(FATAL_ERROR "libcamera is not here (the sensor's driver needs it): install libcamera-dev, or run ./dev build, which installs everything")
endif()
pkg_check_modules(aravis IMPORTED_TARGET aravis-0.8)
if(NOT aravis_FOUND)
  message(FATAL_ERROR "Aravis, which the driver of GenICam cameras needs, is missing: install libaravis-dev and libusb-1.0-0-dev, or run ./dev build, which installs everything")
endif()
pkg_check_modules(systemd REQUIRED IMPORTED_TARGET libsystemd)
pkg_check_modules(sqlite REQUIRED IMPORTED_TARGET sqlite3)
pkg_check_modules(png REQUIRED IMPORTED_TARGET libpng)
find_package(ZLIB REQUIRED)  # of libpng's package
pkg_check_modules(tiff IMPORTED_TARGET libtiff-4>=4.5)
if(NOT tiff_FOUND)
  message(FATAL_ERROR "libtiff 4.5 or later, which reads frames and writes maps, is missing: install libtiff-dev, or run ./dev build, which installs everything")
endif()
pkg_check_modules(libmd REQUIRED IMPORTED_TARGET libmd)  # SHA-256; its run time is on every Debian system (dpkg needs it)

pkg_check_modules(mosquitto IMPORTED_TARGET libmosquitto)
if(NOT mosquitto_FOUND)
  message(FATAL_ERROR "libmosquitto is missing, which hord-mqtt is built with: apt-get install libmosquitto-dev")
endif()

# Of the page alone (firmware/page). pkg-config's own complaint does not name Debian's package.
pkg_check_modules(microhttpd IMPORTED_TARGET libmicrohttpd)
if(NOT microhttpd_FOUND)
  message(FATAL_ERROR "libmicrohttpd, which hord-page answers browsers with, is missing: install libmicrohttpd-dev")
endif()
pkg_check_modules(prometheus IMPORTED_TARGET prometheus-cpp-core)
if(NOT prometheus_FOUND)
  message(FATAL_ERROR "prometheus-cpp, which hord-page writes /metrics with, is missing: install prometheus-cpp-dev")
endif()
