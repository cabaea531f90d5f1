"""Images in and out: sources that give reflectance window by window, sinks that appear whole or not at all."""
