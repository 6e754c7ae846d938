"""Charts as pure functions from rows and a theme to a plotly Figure, without database, request or clock.

Rows are in seconds and metres; charts show milliseconds per frame and centimetres. An empty list gives a
figure without traces, never an error. No chart needs eval in the browser (no scattergl, no parcoords). All
text of clients is escaped.
"""
