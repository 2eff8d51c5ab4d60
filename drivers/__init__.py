"""Controller-side drivers for the valve, the pressure sensors and the position sensor."""
