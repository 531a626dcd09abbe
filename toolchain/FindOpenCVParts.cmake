# The four parts of OpenCV that the commissioning tool uses, found one by one: Debian's OpenCVConfig.cmake
# comes only with libopencv-dev, which draws 370 packages in and wants every part to be there.
# Gives OpenCVParts_FOUND and the targets opencv_part_core, _imgproc, _calib3d, _imgcodecs.
find_path(OPENCV_PARTS_INCLUDE opencv2/calib3d.hpp PATH_SUFFIXES opencv4)
set(OpenCVParts_FOUND FALSE)
if(OPENCV_PARTS_INCLUDE)
  set(OpenCVParts_FOUND TRUE)
  foreach(part core imgproc calib3d imgcodecs)
    find_library(OPENCV_PARTS_${part} opencv_${part})
    if(NOT OPENCV_PARTS_${part})
      set(OpenCVParts_FOUND FALSE)
    elseif(NOT TARGET opencv_part_${part})
      add_library(opencv_part_${part} INTERFACE IMPORTED GLOBAL)
      target_link_libraries(opencv_part_${part} INTERFACE "${OPENCV_PARTS_${part}}")
      target_include_directories(opencv_part_${part} INTERFACE "${OPENCV_PARTS_INCLUDE}")
    endif()
  endforeach()
endif()
