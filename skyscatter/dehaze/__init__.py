"""Taking haze off images: the atmosphere run backwards."""
