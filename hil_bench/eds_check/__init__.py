"""What is wrong in an EDS file, line by line (CiA 306), beyond what loaders notice.

>>> for finding in check_eds(Path("vendor.eds")):
...     print(finding)
"""

from hil_bench.eds_check.check import check_eds
from hil_bench.eds_check.document import Finding

__all__ = ["Finding", "check_eds"]
