"""Export of the contract: schemas, golden vectors, AsyncAPI and the page of messages. No run needs it."""
