"""Analyses of the valve-controlled cylinder, offline (Ruderman 2017, section IV)."""
