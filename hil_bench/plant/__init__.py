"""The valve-controlled hydraulic cylinder of Ruderman, IECON 2017."""
