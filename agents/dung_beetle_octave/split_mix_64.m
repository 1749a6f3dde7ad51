function [state, fraction] = split_mix_64(state)
  % Return the generator's next state (uint64) and the next random number in [0, 1).
  %
  % Integers saturate in this language where SplitMix64 needs arithmetic modulo 2^64, so that words are taken apart.
  state = add(state, 0x9E3779B97F4A7C15);
  z = multiply(bitxor(state, bitshift(state, -30)), 0xBF58476D1CE4E5B9);
  z = multiply(bitxor(z, bitshift(z, -27)), 0x94D049BB133111EB);
  z = bitxor(z, bitshift(z, -31));
  fraction = double(bitshift(z, -11)) / 2^53;
end

function c = add(a, b)
  % Return a + b modulo 2^64.
  low = low_word(a) + low_word(b);
  high = high_word(a) + high_word(b) + high_word(low);
  c = join(high, low);
end

function c = multiply(a, b)
  % Return a * b modulo 2^64; the products of two words of 32 bits are below 2^64, so these are exact.
  low = low_word(a) * low_word(b);
  high = high_word(low) + low_word(high_word(a) * low_word(b)) + low_word(low_word(a) * high_word(b));
  c = join(high, low);
end

function word = low_word(a)
  word = bitand(a, 0x00000000FFFFFFFF);
end

function word = high_word(a)
  word = bitshift(a, -32);
end

function c = join(high, low)
  c = bitor(bitshift(low_word(high), 32), low_word(low));
end
