"""Check of an EDS file, line by line (CiA 306), beyond the checks of loaders.

>>> for finding in check_eds(Path("vendor.eds")):
...     print(finding)
"""

from hil_bench.abilities.conformance.eds_check.check import check_eds
from hil_bench.canopen_device.eds_document import EdsFinding, Severity

__all__ = ["EdsFinding", "Severity", "check_eds"]
