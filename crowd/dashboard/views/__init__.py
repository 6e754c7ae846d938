"""The views of the pages. Each parses the request, calls selectors, and renders a template."""
