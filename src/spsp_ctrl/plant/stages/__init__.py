"""The stages of the plant, in the order in which an effect travels: drive, transmission, mechanism, azimuth, thermal, sensors."""
