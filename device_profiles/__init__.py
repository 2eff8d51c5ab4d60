"""Device descriptions as data: one EDS file (CiA 306) a device, and where to find it."""
