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

pkg_check_modules(hdf5 IMPORTED_TARGET hdf5-serial)
if(NOT hdf5_FOUND)
  pkg_check_modules(hdf5 IMPORTED_TARGET hdf5)
endif()
if(NOT hdf5_FOUND)
  message(FATAL_ERROR "HDF5, which hordctl export and import use, is missing: install libhdf5-dev, or run ./dev build, which installs everything")
endif()

# Of `import hord` alone (lab/python): Debian's Python, whose NumPy and h5py are packages, not another one in the PATH.
# A sanitizer's run time would have to be loaded before Python; a cross-built module needs another Python's headers.
set(python_here ON)
if(HORD_SANITIZE OR CMAKE_CROSSCOMPILING)
  set(python_here OFF)
endif()
option(HORD_PYTHON "Build the Python module" ${python_here})
if(HORD_PYTHON)
  set(Python_EXECUTABLE /usr/bin/python3 CACHE FILEPATH "Python that the module is built for")
  find_package(Python COMPONENTS Interpreter Development.Module)
  find_package(pybind11 QUIET)
  if(NOT Python_FOUND OR NOT pybind11_FOUND)
    message(FATAL_ERROR "pybind11 or Python's headers, which `import hord` is built with, are missing: install pybind11-dev and python3-dev, run ./dev build, which installs everything, or configure with -DHORD_PYTHON=OFF")
  endif()
endif()
