"""A crowd that nobody is: plausible devices whose made-up sessions come in through the real API, labelled."""
