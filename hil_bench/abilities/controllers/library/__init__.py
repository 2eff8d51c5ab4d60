"""Controllers as shared libraries with the six functions of `hil_controller.h`."""
