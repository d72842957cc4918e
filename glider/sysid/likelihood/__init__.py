"""The likelihood of flights: sensor noise, moving air, flight-to-flight variation."""
