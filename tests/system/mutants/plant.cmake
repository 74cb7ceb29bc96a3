# Copies FILE to OUT with PATCH applied. A patch that does not fit any more leaves the file as it is, without a bug: then the
# mutant's test fails, and the build goes on.
execute_process(COMMAND patch --silent --fuzz=2 --output=${OUT} ${FILE} ${PATCH} RESULT_VARIABLE status OUTPUT_VARIABLE said ERROR_VARIABLE said)
if(NOT status EQUAL 0)
  message(WARNING "${PATCH} does not fit ${FILE} any more: make it anew (tests/system/mutants/README.md). ${said}")
  file(COPY_FILE ${FILE} ${OUT})
endif()
