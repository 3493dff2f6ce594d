"""A second source of recordings with hidden effects; shares no code with the product nor with the first source."""
