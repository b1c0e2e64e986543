"""The look before a flight: settings, camera, link, clocks, disk and zenoh, each with a remedy."""
